"""How the whole pilot is taught, once its parts can: from frames to forces, along flights."""

from __future__ import annotations

from torch import Tensor

from proxops.training.data import PackedFlights, Similarity
from proxops.training.loop import Batch, Lesson, Schedule, frame_loaders
from proxops.training.pilot.lessons import FILTER_SETTLES, estimate_error, force_loss
from proxops.training.pilot.network import Pilot

# Of the error of the estimate, which keeps the parts what they are, beside that of the force.
_ESTIMATE_WEIGHT = 0.1


def whole_lesson(
    pilot: Pilot,
    flights: PackedFlights,
    alike: Similarity,
    length: int,
    schedule: Schedule,
    seed: int,
    identity: str,
) -> Lesson:
    """Teaches all parts but the motion at once what the expert commanded along windows of flights.

    The windows begin in flight, where the filter has to find position and speed first; what it
    says before that is not held against it.
    """

    def loss(network: Pilot, batch: Batch) -> Tensor:
        forces, estimates, _ = network.sequence(
            batch["frames"], batch["target"], batch["applied_force"]
        )
        settled = slice(FILTER_SETTLES, None)
        asked = batch["labelled"][:, settled]
        wanted = batch["mpc_force"][:, settled][asked]
        off = force_loss(forces[:, settled][asked], wanted, network.guidance.thrust_limit)
        lost = estimate_error(estimates[:, settled], batch["state"][:, settled], alike)
        return off + _ESTIMATE_WEIGHT * lost.mean()

    batches = frame_loaders(flights, length, None, schedule.batch, seed)
    return Lesson("whole", pilot, loss, *batches, identity, threads=1, methods=("sequence",))
