"""The stage at which a target was lost, from its evidence, with an explanation."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

from unlidar.explain.evidence import BELOW_THRESHOLD, SECOND_NS, Evidence

FOUND, TRACK, GATE, PATH = "found", "track", "gate", "path"
DETECTION, UNSEARCHED = "detection", "unsearched"
BODY, STRUCTURE, NO_RETURN = "body", "structure", "no return"


@dataclass(frozen=True)
class Meaning:
    """One plain sentence, with the relevant configuration keys and page."""

    sentence: str
    keys: tuple[str, ...]  # of configs/default.yaml
    page: str  # below docs/


MEANINGS = {
    FOUND: Meaning("The trajectory is there.", (), "evaluate.md"),
    TRACK: Meaning(
        "A path became a track, but the trajectory has no row there: its sigma is too large, the "
        "target went undetected for too long, or the fit went elsewhere.",
        ("trajectory.max_sigma_m", "trajectory.min_missed_run_probability"),
        "method.md#8-trajectory",
    ),
    PATH: Meaning(
        "Detections form a path, but clutter explains them as well: its score is below the "
        "threshold.",
        ("robust.false_alarms_per_recording",),
        "method.md#6-decision",
    ),
    DETECTION: Meaning(
        "There are detections, but no path through them is likelier than clutter: too few, too far "
        "apart, or where clutter is common (log clutter: -10 to -13 is open air).",
        ("robust.tracker.max_gap_s", "robust.tracker.return_rate_m2_per_s"),
        "method.md#4-plots-and-their-clutter",
    ),
    UNSEARCHED: Meaning(
        "There are detections, but a stream does not search them: the scene is still being learned "
        "after the start, or once more since detections surged as when rain begins.",
        ("robust.disabled_rules",),
        "live.md#weather-and-the-window",
    ),
    BODY: Meaning(
        "Its returns were taken for a person or a vehicle: they reach down to the ground, or are "
        "wider than a drone.",
        ("robust.plots.body_spread_m", "robust.disabled_rules"),
        "method.md#3-scene",
    ),
    STRUCTURE: Meaning(
        "There are returns, but the scene explains them: the place returns at other times as well.",
        ("robust.background.max_occupancy", "robust.background.place"),
        "method.md#3-scene",
    ),
    NO_RETURN: Meaning(
        "No LiDAR has a return there: too far away, hidden or out of the field of view; or pose, "
        "clock or truth are off.",
        ("sensors", "input.max_range_m"),
        "own_sensor.md",
    ),
}
# The program's rules (src/tracking/rejection.hpp) that a stage stands for, and all others.
RULES = {
    "structure": STRUCTURE,
    "body": BODY,
    "warm_up": UNSEARCHED,
    "surge": UNSEARCHED,
    BELOW_THRESHOLD: PATH,
    "lost": TRACK,
}
GATES = {
    "pause": Meaning(
        "A path of a stream goes on after a pause, over which it may reach back to strays, a car "
        "or a walker: what precedes the pause is cut off.",
        ("robust.disabled_rules",),
        "live.md#why-was-it-lost",
    ),
    "too_few_detections": Meaning(
        "A path is above the threshold, but in too few frames: clutter that repeats itself is no "
        "evidence.",
        ("robust.min_plots",),
        "method.md#6-decision",
    ),
    "near_ground": Meaning(
        "Too little of a path is higher than people and vehicles, and something may stand below.",
        ("robust.off_ground_m",),
        "method.md#6-decision",
    ),
    "on_structure": Meaning(
        "Too little of a path is higher above a bridge, a roof or other structure than people and "
        "vehicles that it carries.",
        ("robust.off_ground_m", "robust.disabled_rules"),
        "method.md#6-decision",
    ),
    "stationary": Meaning(
        "A path of a stream stays where it is and something may hold it up: a twig that is hit "
        "more often for a while does so.",
        ("robust.support.reach", "robust.disabled_rules"),
        "live.md#why-was-it-lost",
    ),
    "weak_return": Meaning(
        "A path returns from too few of the lines of sight at its range: an insect, a leaf.",
        ("robust.min_cross_section_m2",),
        "method.md#6-decision",
    ),
    "crowded": Meaning(
        "A path's score, less what else is detected about it at the same time or in bursts, is "
        "below the threshold: a bush in a gust shows all at once, a twig again and again.",
        ("robust.false_alarms_per_recording", "robust.disabled_rules"),
        "method.md#6-decision",
    ),
    "part_of_another_track": Meaning(
        "Most returns of a path are those of a track that it continues.",
        (),
        "method.md#7-collection",
    ),
    "shares_returns": Meaning(
        "Most returns of a path are those of several tracks, or of people and vehicles.",
        (),
        "method.md#7-collection",
    ),
    "single_measurement": Meaning(
        "Of a path the collection of all returns left one measurement at most.",
        (),
        "method.md#7-collection",
    ),
    "suspended": Meaning(
        "A path is far away and at rest to within the noise, as a sign or a lamp on a cable is.",
        ("robust.support.max_range_m", "robust.disabled_rules"),
        "method.md#7-collection",
    ),
    "cloud": Meaning(
        "What flies there is wider across its motion than any drone, or a piece of what is: steam, "
        "dust.",
        ("robust.disabled_rules",),
        "method.md#7-collection",
    ),
    "insect": Meaning(
        "What flies there is narrower than any drone.",
        ("robust.disabled_rules",),
        "method.md#7-collection",
    ),
}
_OTHER_GATE = Meaning(
    "A rule that this version of unlidar does not know refused a path.", (), "explain.md"
)


@dataclass(frozen=True)
class Run:
    """Consecutive seconds of one stage."""

    begin_ns: int
    end_ns: int
    stage: str
    evidence: Evidence  # of all of them

    @property
    def seconds(self) -> int:
        """The number of seconds."""
        return (self.end_ns - self.begin_ns) // SECOND_NS


def stage_of(evidence: Evidence) -> str:
    """The first stage that none of the target's evidence passed, or FOUND."""
    if evidence.rows_near:
        return FOUND
    if evidence.path is not None:
        rejection = evidence.path.rejection
        if rejection is None:
            return TRACK
        return PATH if rejection == BELOW_THRESHOLD else f"{GATE} {rejection}"
    if evidence.detections:
        return DETECTION if evidence.unsearched < evidence.detections else UNSEARCHED
    if evidence.bodies:
        return BODY
    return STRUCTURE if evidence.returns else NO_RETURN


def meaning_of(stage: str) -> Meaning:
    """The meaning of a stage, also of `gate NAME`."""
    kind, _, name = stage.partition(" ")
    return GATES.get(name, _OTHER_GATE) if kind == GATE else MEANINGS[stage]


def runs_of(found: dict[int, Evidence]) -> list[Run]:
    """Runs of consecutive seconds of one stage, from evidence by the begin of its second."""
    runs: list[Run] = []
    for begin_ns in sorted(found):
        stage = stage_of(found[begin_ns])
        if not runs or (runs[-1].stage, runs[-1].end_ns) != (stage, begin_ns):
            runs.append(Run(begin_ns, begin_ns, stage, Evidence()))
        runs[-1].evidence.add(found[begin_ns])
        runs[-1] = replace(runs[-1], end_ns=begin_ns + SECOND_NS)
    return runs


def shares_of(runs: Iterable[Run]) -> dict[str, float]:
    """The share of each stage in all seconds, the largest first."""
    seconds: dict[str, int] = {}
    for run in runs:
        seconds[run.stage] = seconds.get(run.stage, 0) + run.seconds
    total = sum(seconds.values())
    ordered = sorted(seconds.items(), key=lambda one: (-one[1], one[0]))
    return {stage: count / total for stage, count in ordered}


def measured(evidence: Evidence, stage: str) -> str:
    """The numbers that support the stage, in a few words."""
    there = f"{_count(evidence.returns, 'return')} in {_count(evidence.frames, 'frame')}"
    if stage == NO_RETURN:
        return f"{there}, {_range(evidence)} away" if evidence.frames else "no frame"
    if stage == STRUCTURE:
        return f"{there}, {_range(evidence)} away, no detection"
    if stage == BODY:
        return f"{there}, {evidence.bodies} of them of bodies"
    if stage == UNSEARCHED:
        return f"{_count(evidence.detections, 'detection')}, none searched"
    if stage == DETECTION:
        notes = [f"{_count(evidence.detections, 'detection')} ({evidence.unsupported} unsupported)"]
        if bounded := evidence.detections - evidence.unbounded:
            notes.append(f"mean log clutter {evidence.log_clutter / bounded:.1f}")
        if evidence.unbounded:
            notes.append(f"{evidence.unbounded} amid clutter without bound")
        return ", ".join([*notes, "no path"])
    if stage in (FOUND, TRACK):
        rows = f"{evidence.rows_near} of {evidence.rows} rows there"
        if evidence.rows_near:
            return f"{rows}, mean error {evidence.error_m / evidence.rows_near:.2f} m"
        near = f", the nearest {evidence.least_error_m:.1f} m off" if evidence.rows else ""
        return f"{rows}{near}"
    path = evidence.path
    assert path is not None
    score = f"score {path.log_likelihood_ratio:.1f} of {path.threshold:.1f}"
    if stage == PATH:
        score += f", {path.threshold - path.log_likelihood_ratio:.1f} too little"
    if path.crowding_penalty:
        score += f", {path.crowding_penalty:.1f} less for neighbours"
    return f"{score}; {_count(path.detections, 'detection')} there"


def _count(number: int, name: str) -> str:
    return f"{number} {name}{'s' * (number != 1)}"


def _range(evidence: Evidence) -> str:
    low, high = f"{evidence.least_range_m:.0f}", f"{evidence.most_range_m:.0f}"
    return f"{low} m" if low == high else f"{low} to {high} m"
