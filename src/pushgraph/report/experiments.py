"""The experiments of the report, in the paper's order: what the paper says, the command that repeats it, the tables."""

from collections.abc import Mapping
from dataclasses import dataclass

from pushgraph.report.tables import View


@dataclass(frozen=True)
class Experiment:
    """One suite of `pushgraph evaluate`.

    paper: what the paper's text and figures say. command: the suite and the options that it always has. counts:
    options that say how much is measured, by the report's size. figures: files that the suite writes, and what each
    shows.
    """

    name: str
    title: str
    paper: str
    command: tuple[str, ...]
    counts: Mapping[str, tuple[str, ...]]
    views: tuple[View, ...]
    figures: Mapping[str, str]


SIZES = ("quick", "normal", "full")
"""How much a report measures: a few minutes, half an hour, or as much as the paper, which takes a night."""
_ROLLOUT = {"mean error (cm)": "mean_error_cm", "final, moved (cm)": "final_error_moved_cm"}


def counts_of(quick: int, normal: int, full: int, *more_of_quick: str) -> dict[str, tuple[str, ...]]:
    """Options of every size: how many scenes; and what a quick report says beside."""
    counts = {size: ("--count", str(count)) for size, count in zip(SIZES, (quick, normal, full), strict=True)}
    return counts | {"quick": (*counts["quick"], *more_of_quick)}


NINE = ("--objects", "9")
EXPERIMENTS = (
    Experiment(
        name="physics",
        title="Physics prediction with true joints",
        paper="Of 1,000 trajectories more than 600 have a mean error under 0.1 cm after 30 frames and nearly all "
        "others under 0.4 cm; after 50 frames fewer than 400 are under 0.1 cm. The network on object-centric "
        "images has its errors at the high end. Its simulator and data are not available: `propnet` and "
        "`image` are the paper's two networks, trained and measured here.",
        command=("evaluate", "physics"),
        counts=counts_of(6, 20, 1000, *NINE),
        views=(
            View(
                "Rollouts, 95 % intervals in brackets",
                ("objects", "frames", "model"),
                _ROLLOUT | {"median of that (cm)": "median_final_error_moved_cm", "under 0.1 cm": "share_under_0.1_cm"},
                {"frames": (30, 50), "density": ("all",)},
            ),
        ),
        figures={"histogram.png": "Trajectories by mean error"},
    ),
    Experiment(
        name="belief",
        title="Which joints there are, from watching",
        paper="Accuracy, precision and recall rise with observed frames; fixed and revolute are confused until they"
        " are touched; independent of the number of objects.",
        command=("evaluate", "belief"),
        counts=counts_of(6, 20, 1000, *NINE),
        views=(
            View(
                "Pairs that were touched: share told right, and expected calibration error",
                ("objects", "observed_frames", "noise", "model"),
                {"accuracy": "accuracy", "calibration error": "ece"},
                {"observed_frames": (10, 40, 100, 200), "pairs": ("touched",), "joint": ("all",)},
                digits=3,
            ),
        ),
        figures={
            "curves.png": "Accuracy, precision and recall over observed frames",
            "reliability.png": "How often answers of a stated probability are right",
        },
    ),
    Experiment(
        name="coupled",
        title="Both together: prediction with believed joints",
        paper="After 40 observed frames the error with believed joints has come down to that with true ones.",
        command=("evaluate", "coupled"),
        counts=counts_of(6, 20, 1000, *NINE),
        views=(
            View(
                "Mean error of the next 50 frames",
                ("objects", "observed_frames", "model"),
                {"error (cm)": "error_cm"},
                {"observed_frames": (0, 20, 40, 100)},
            ),
        ),
        figures={"coupled.png": "Error over observed frames, by what is assumed of joints"},
    ),
    Experiment(
        name="masses",
        title="What weighs how much, from watching",
        paper="The mean error of masses comes down to 2.7 kg; always answering the median errs by 3.0 kg. What "
        "motion can tell are ratios of bodies that touched: `ratio_observer` knows those.",
        command=("evaluate", "masses"),
        counts=counts_of(6, 20, 1000, *NINE),
        views=(
            View(
                "Masses after 200 observed frames",
                ("objects", "input", "model", "subset"),
                {"error (kg)": "mean_abs_error_kg", "interval right": "interval_accuracy", "68 % hold": "coverage_68"},
                {"observed_frames": (200,)},
            ),
        ),
        figures={"curves.png": "Error over observed frames"},
    ),
    Experiment(
        name="controlled-masses",
        title="Two scenes in which only masses change",
        paper="Mean errors of the scenes mostly under 2 kg; light and heavy are told apart, normal less often.",
        command=("evaluate", "controlled-masses"),
        counts=counts_of(40, 200, 1000, "--objects", "2"),
        views=(
            View(
                "Scenes of two and three bodies",
                ("objects", "input", "model"),
                {
                    "error (kg)": "mean_abs_error_kg",
                    "interval right": "interval_accuracy",
                    "under 1 kg": "share_under_1_kg",
                },
            ),
        ),
        figures={
            "histograms.png": "Scenes by mean error",
            "confusion.png": "Classes of mass: true ones, and what was said",
        },
    ),
    Experiment(
        name="coupled-masses",
        title="Prediction with believed masses",
        paper="no number.",
        command=("evaluate", "coupled-masses"),
        counts=counts_of(6, 20, 500, *NINE),
        views=(
            View(
                "Mean error of the next 50 frames",
                ("objects", "observed_frames", "model"),
                {"error (cm)": "error_cm"},
                {"observed_frames": (0, 20, 40, 100, "first_push")},
            ),
        ),
        figures={"coupled.png": "Error over observed frames, by what is assumed of masses"},
    ),
    Experiment(
        name="tools",
        title="Tools that were never seen",
        paper="About 40 of 166 tasks with one tool and about 130 with all of them, most likely within 10 cm.",
        command=("evaluate", "tools"),
        counts=counts_of(14, 154, 154),
        views=(
            View(
                "Where the object ended, executed in simulation",
                ("model", "loop", "executed", "tool"),
                {"distance (cm)": "mean_error_cm", "within 5 cm": "success_5cm", "within 10 cm": "success_10cm"},
                {"tool": ("all",)},
            ),
        ),
        figures={"tools.png": "Tasks that succeed, by tool"},
    ),
    Experiment(
        name="clutter",
        title="Bringing bodies to goals among jointed ones",
        paper="not studied.",
        command=("evaluate", "clutter"),
        counts={
            "quick": ("--count", "2", "--contender", "belief", "--contender", "no_joint"),
            "normal": ("--count", "10"),
            "full": ("--count", "60"),
        },
        views=(
            View(
                "Nine bodies, joints unknown, goals 20 cm away",
                ("goal", "model"),
                {"within 3 cm": "success_3cm", "pose reached": "success_pose", "pushes": "pushes"},
            ),
        ),
        figures={},
    ),
    Experiment(
        name="camera",
        title="The paper's protocol of a real robot, on simulated recordings",
        paper="On real recordings, final errors of 3.5 cm where bodies move by 19.5 cm; from first contact below "
        "6.5 cm with true and 8.5 cm with believed joints.",
        command=("evaluate", "camera"),
        counts=counts_of(12, 102, 102),
        views=(
            View(
                "Final error",
                ("start", "model"),
                {"error (cm)": "final_error_cm", "they moved (cm)": "motion_cm"},
                {"start": ("contact", "contact+4", 20, 40, 80, "all")},
            ),
        ),
        figures={"curves.png": "Final error, from first contact on and over observed frames"},
    ),
    Experiment(
        name="lever-up",
        title="Levering a board out of a drive, in 6D",
        paper="Plausible motions; no number.",
        command=("evaluate", "lever-up"),
        counts=counts_of(4, 24, 120),
        views=(
            View(
                "Boards that were raised, medians",
                ("model",),
                {"final position (mm)": "final_position_error_mm", "final rotation (deg)": "final_rotation_error_deg"},
                {"subset": ("raised",), "side": ("all",), "ledge": ("all",)},
            ),
        ),
        figures={},
    ),
    Experiment(
        name="spread",
        title="How sure predictions are",
        paper="not studied.",
        command=("evaluate", "spread"),
        counts=counts_of(6, 20, 200, *NINE),
        views=(
            View(
                "Share of bodies that moved whose true place lies within the stated 68 % and 95 %",
                ("objects", "frames", "joints", "observed_frames", "masses"),
                {"68 %": "coverage_68", "95 %": "coverage_95"},
                {"bodies": ("moved",), "density": ("all",)},
            ),
        ),
        figures={"coverage.png": "Stated against true shares"},
    ),
)
