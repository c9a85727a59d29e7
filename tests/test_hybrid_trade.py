"""The table of what the hybrid trades: its variants are what they are named, its figures right."""

from types import ModuleType

import pytest
from scripts import load_script
from test_evaluation import row


@pytest.fixture(scope="module")
def trade() -> ModuleType:
    return load_script("benchmarks/hybrid.py")


def test_figures(trade: ModuleType) -> None:
    """Δv is paired; what fails, of either, has none."""
    matched = [
        row(delta_v_m_s=100.0, control_ms_mean=2.0),
        row(delta_v_m_s=200.0, control_ms_mean=2.0),
        row(delta_v_m_s=1.0, control_ms_mean=2.0),
    ]
    hybrid = {"policy_share": 0.9, "policy_share_to_arrival": 0.8, "control_ms_mean": 0.5}
    rows = [
        row(delta_v_m_s=110.0, mpc_solves=46, **hybrid),
        row(delta_v_m_s=206.0, mpc_solves=23, **hybrid),
        row(delta_v_m_s=9.0, mpc_solves=69, success=False, keep_out_violations=2, **hybrid)
        | {"min_clearance_m": -500.0},
    ]
    assert trade.figures(rows, matched) == [
        "2/3", "2", "-0.50", "90.0", "80.0", "90.0", "1.065", "1.100", "0.50", "4.0",
    ]  # fmt: skip
    assert trade.figures(matched, matched)[6:8] == ["1.000", "1.000"]
    lost = [row(success=False)]
    assert trade.figures(lost, lost)[6] == "–"
    flown = {trade.MPC: matched, "strict, 10": rows, "zero: strict, 10": rows}
    [axes] = trade.trade_plot(flown, "title").axes
    texts = [text.get_text() for text in axes.texts]
    assert texts == ["MPC", "strict, 10 (33 % fail)", "zero: strict, 10 (33 % fail)"]
    points = [line.get_xydata()[0].tolist() for line in axes.lines[:3]]
    assert points[0] == [0.0, 1.0]
    assert points[1] == pytest.approx([90.0, 1.065])
