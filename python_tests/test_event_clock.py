"""The time of a stream of events: one stamp alone moves nothing, a recording is of its own time."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st
from unlidar.events.clock import Heard, Progress, StreamClock

NOW_S = 1_790_000_000.0
THEN_S = 1_706_301_000.0
YEAR_S = 365 * 86400.0
FAR_S = st.floats(2 * 86400, 50 * YEAR_S)


class Machine:
    """Clocks of a computer, which pass when they are told to."""

    def __init__(self) -> None:
        self.passed_s = 0.0
        self.clock = StreamClock(lambda: NOW_S + self.passed_s, lambda: 5.0 + self.passed_s)

    def says(self, stamp_s: float) -> bool:
        return self.clock.believes(round(stamp_s * 1e9))

    def heard(self) -> Heard:
        return self.clock.heard(self.clock.newest_ns)

    def newest_s(self) -> float:
        return self.clock.newest_ns * 1e-9


@given(st.lists(st.tuples(st.booleans(), FAR_S), max_size=30))
def test_in_a_stream_of_now_no_stamp_of_another_time_is_believed(others) -> None:
    machine = Machine()
    for ahead, far_s in others:
        assert machine.says(NOW_S + machine.passed_s - 0.5)
        heard = machine.heard()
        assert not machine.says(NOW_S + (far_s if ahead else -far_s - 8 * 86400))
        assert machine.newest_s() == NOW_S + machine.passed_s - 0.5
        assert machine.clock.age_s(heard) == 0
        machine.passed_s += 1


def test_a_recording_is_of_its_own_time_from_the_first_stamp_to_the_last() -> None:
    machine = Machine()
    stamps = [THEN_S + t for t in (0.0, 0.1, 0.1, 0.05, 3600.0, 30_000.0, 29_000.0)]
    assert all(machine.says(stamp_s) for stamp_s in stamps)
    assert machine.newest_s() == stamps[-1]
    machine.passed_s += 2.5
    assert machine.clock.now_ns() * 1e-9 == stamps[-1] + 2.5


@given(st.sampled_from((1, -1)), FAR_S)
def test_one_stamp_years_off_ages_nothing_in_a_recording(sign, far_s) -> None:
    machine = Machine()
    machine.says(THEN_S)
    heard = machine.heard()
    if machine.says(THEN_S + sign * far_s):  # borne out by this computer's clock by chance
        assert abs(THEN_S + sign * far_s - NOW_S) <= 7 * 86400
    assert machine.says(THEN_S + 0.1) or machine.clock.age_s(heard) <= 10
    assert machine.clock.age_s(heard) <= 10


def test_who_comes_first_from_the_future_hides_nobody() -> None:
    machine = Machine()
    assert machine.says(NOW_S + 70 * YEAR_S)
    assert machine.says(NOW_S)
    assert machine.newest_s() == NOW_S
    assert not machine.says(NOW_S + 70 * YEAR_S)


def test_a_stream_whose_clock_was_lost_is_believed_again_when_its_stamps_agree() -> None:
    machine = Machine()
    assert machine.says(NOW_S)
    told = []
    for _ in range(60):  # a LiDAR without PTP counts from its start
        machine.passed_s += 1
        told.append(machine.says(100.0 + machine.passed_s))
    assert not any(told[:25])
    assert all(told[35:])
    machine.passed_s += 0.1
    assert machine.says(NOW_S + machine.passed_s)  # PTP is there again
    assert machine.heard().live


def test_stamps_that_do_not_agree_are_never_believed() -> None:
    machine = Machine()
    assert machine.says(THEN_S)
    assert not any(machine.says(NOW_S + YEAR_S * (1 + i)) for i in range(20))
    assert machine.newest_s() == THEN_S


def test_what_is_of_now_grows_old_by_this_computers_clock_alone() -> None:
    machine = Machine()
    machine.says(NOW_S)
    heard = machine.heard()
    for behind_s in (5000, 4000, 3000, 2000):
        machine.says(NOW_S - behind_s)
    assert machine.clock.age_s(heard) == 0
    machine.passed_s += 70
    assert machine.clock.age_s(heard) == 70


def test_a_recording_grows_old_by_its_stamps_however_fast_it_is_played() -> None:
    machine = Machine()
    machine.says(THEN_S)
    heard = machine.heard()
    for second in range(1, 101):
        machine.says(THEN_S + second)
    assert round(machine.clock.age_s(heard)) == 100
    machine.passed_s += 300  # nothing comes any more
    assert machine.clock.age_s(heard) == 300


def test_a_clock_at_the_edge_of_what_is_borne_out_is_believed_all_the_time() -> None:
    machine = Machine()
    for step in range(200):
        machine.passed_s += 0.1
        assert machine.says(NOW_S + machine.passed_s + 9.9 + 0.2 * (step % 2))


def test_streams_that_lag_behind_each_other_do_not_add_up() -> None:
    progress = Progress()
    clocks = [StreamClock(lambda: NOW_S, lambda: 0.0, progress) for _ in range(5)]
    heard = clocks[0].heard(round(THEN_S * 1e9))
    for second in range(20):
        for i, clock in enumerate(clocks):
            assert clock.believes(round((THEN_S + second - 500 * i) * 1e9))
    assert round(clocks[0].age_s(heard)) == 19
