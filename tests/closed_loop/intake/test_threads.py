"""Small matrices are multiplied on one thread, whatever the machine has."""

from threadpoolctl import threadpool_info, threadpool_limits

from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.intake.threads import keep_to_one_thread


def count_threads():
    return {one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"}


def test_linear_algebra_keeps_to_one_thread_and_is_as_before_afterwards():
    with threadpool_limits(2):
        assert keep_to_one_thread(count_threads)() == {1}
        assert count_threads() == {2}
    assert diagnose.__wrapped__.__name__ == "diagnose"
