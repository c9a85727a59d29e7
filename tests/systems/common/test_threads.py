"""Linear algebra on one thread, whatever the number was before, and as before afterwards."""

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from proxops.systems.common import one_thread, threads_to_use


def threads() -> set[int]:
    return {each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas"}


@pytest.mark.parametrize("before", [1, 2])
def test_one_thread_within_and_as_before_afterwards(before: int) -> None:
    np.linalg.inv(np.eye(3))
    with threadpool_limits(limits=before, user_api="blas"):
        with one_thread():
            assert threads() == {1}
        assert threads() == {before}
        with pytest.raises(ZeroDivisionError), one_thread():
            _ = 1 / 0
        assert threads() == {before}


def test_threads_to_use(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    assert threads_to_use() == 3
    with one_thread():
        assert threads_to_use() == 1
    monkeypatch.delenv("OMP_NUM_THREADS")
    assert threads_to_use() >= 1
