"""The policy's system with networks known in closed form: answers, memory, limits, refusals."""

from pathlib import Path

import numpy as np
import pytest
from known_policies import RAYS, Counting, remember, write_policy
from one_system import context_of
from short_flights import kleopatra

from proxops.systems import InputError, LidarGeometry, NeuralPolicy, PolicyBundle, PolicyStatus
from proxops.systems.policy import neural_policy

TARGET = np.array([160e3, 8e3, 0.0, 0.0, 0.0, 0.0])
FRAME = np.full(RAYS, np.inf)
FRAME[[7, 4000]] = [120e3, 90e3]


@pytest.fixture(scope="module")
def counting(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_policy(tmp_path_factory.mktemp("counting") / "policy", Counting())


def flown(policy: NeuralPolicy, applied: np.ndarray, frame: np.ndarray = FRAME) -> list[dict]:
    """All outputs at each step, the policy fed with these applied forces (N, 3)."""
    context = context_of(policy, ranges=frame, target=TARGET)
    rows = []
    for force in applied:
        policy.GetInputPort("commanded_force").FixValue(context, force)
        rows.append(outputs(policy, context))
        remember(policy, context)
    return rows


def outputs(policy: NeuralPolicy, context) -> dict[str, np.ndarray]:
    names = ("force", "estimate", "record")
    return {name: policy.GetOutputPort(name).Eval(context).copy() for name in names}


APPLIED = np.array([[0.0, 0.0, 0.0], [1.0, 0.5, 0.0], [0.0, -2.0, 3.0], [4.0, 0.25, 0.0]])


def test_answers_and_memory(counting: Path) -> None:
    policy = NeuralPolicy(counting)
    rows = flown(policy, APPLIED)
    forces = np.array([row["force"] for row in rows])
    assert forces[:, 0].tolist() == [0.0, 1.0, 2.0, 3.0]
    assert forces[:, 1].tolist() == np.cumsum(APPLIED[:, 1]).tolist()
    assert forces[:, 2] == pytest.approx(np.full(4, 0.9), rel=1e-6)
    assert all(np.isnan(row["estimate"]).all() for row in rows)
    assert all(row["record"][1] == PolicyStatus.ANSWERED for row in rows)
    assert all(row["record"][0] > 0.0 for row in rows)


def test_force_is_clipped(counting: Path) -> None:
    many = np.tile([0.0, -3.0, 0.0], (10, 1))
    forces = np.array([row["force"] for row in flown(NeuralPolicy(counting), many)])
    # The memory holds what it was told, not what was clipped.
    np.testing.assert_array_equal(forces[:, 0], np.minimum(np.arange(10.0), 7.0))
    np.testing.assert_array_equal(forces[:, 1], np.maximum(-3.0 * np.arange(1, 11), -7.0))
    weak = [row["force"] for row in flown(NeuralPolicy(counting, thrust_limit=2.5), many)]
    np.testing.assert_array_equal(np.array(weak)[:, 0], np.minimum(np.arange(10.0), 2.5))


def test_a_fault_of_the_program_ends_the_flight(counting: Path, monkeypatch) -> None:
    def failing(*arguments):
        raise KeyError("memory")

    monkeypatch.setattr(neural_policy, "run_network", failing)
    with pytest.raises(RuntimeError, match="policy failed: 'memory'"):
        flown(NeuralPolicy(counting), APPLIED[:1])


def test_policy_for_something_else_is_refused(counting: Path) -> None:
    with pytest.raises(InputError, match="12 planes of 360 rays, and this one has 6 of 720"):
        NeuralPolicy(counting, geometry=LidarGeometry(6, 720))
    with pytest.raises(InputError, match="period of 10 s, and this one is 5 s"):
        NeuralPolicy(counting, period=5.0)
    with pytest.raises(InputError, match="trained at Kleopatra, of another shape"):
        NeuralPolicy(counting, shape_sha256="0" * 64)
    with pytest.raises(InputError, match="needs thrust_limit above 0"):
        NeuralPolicy(counting, thrust_limit=0.0)
    assert NeuralPolicy(counting, shape_sha256=kleopatra().shape.sha256).thrust_limit == 7.0
    assert NeuralPolicy(PolicyBundle.load(counting)).bundle.path == counting
