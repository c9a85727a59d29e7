"""`KeptFrames`: the lidar's frames of a flight, kept for its log while it is flown."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import Context, Diagram

# Times that are closer than this share of a control period are the same control step: a step's time
# is a sum of shorter steps, and a flight's end one of two settings.
ROUNDING = 1e-9


class KeptFrames:
    """The frames of a transit diagram as they were received, and what became of their returns.

    A log sink is no place for them: it would keep 35 kB a frame in a Diagram that is never freed
    (drake#22515). They were computed for somebody on board in most flights, and are then cached.

    Attributes:
      ranges: float32 (planes * rays,) in m of each frame; +inf: no return.
      use: the navigation's `ReturnUse` int8 (planes * rays,) of each frame; empty without one.
    """

    def __init__(self, diagram: Diagram, period: float):
        """Takes a transit diagram and the control period in s."""
        late = diagram.HasSubsystemNamed("frame_delay")
        self._lidar = diagram.GetSubsystemByName("frame_delay" if late else "lidar")
        self._ranges = self._lidar.GetOutputPort("ranges")
        self._navigation = None
        if diagram.HasSubsystemNamed("navigation"):
            self._navigation = diagram.GetSubsystemByName("navigation")
        self._period, self._slack, self._last = period, ROUNDING * period, -np.inf
        self.ranges: list[np.ndarray] = []
        self.use: list[np.ndarray] = []

    def keep(self, context: Context) -> None:
        """Keeps the frame of a diagram's Context, if that is at a control step."""
        now = context.get_time()
        # An event may end a step of the simulation between two control steps.
        steps = round(now / self._period)
        if now <= self._last or abs(now - steps * self._period) > self._slack:
            return
        if self._last >= steps * self._period:
            return  # A rounding after the control step, whose frame is kept and used.
        if now <= self._last + self._slack:
            # The sum of several steps was a rounding short of the control step, which is now.
            self.ranges.pop()
            del self.use[-1:]
        self._keep_ranges(context)
        if self._navigation is not None:
            here = self._navigation.GetMyContextFromRoot(context)
            use = self._navigation.GetOutputPort("return_use").Eval(here)
            self.use.append(use.astype(np.int8))

    def keep_end(self, context: Context) -> None:
        """Keeps the frame of the flight's end, if that is between two control steps.

        The navigation does not use it.
        """
        if context.get_time() > self._last + self._slack:
            self._keep_ranges(context)
            self.use += [np.zeros_like(self.use[-1])] if self.use else []

    def _keep_ranges(self, context: Context) -> None:
        ranges = self._ranges.Eval(self._lidar.GetMyContextFromRoot(context))
        self.ranges.append(ranges.astype(np.float32))
        self._last = context.get_time()
