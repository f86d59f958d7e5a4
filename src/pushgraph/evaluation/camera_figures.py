"""The figure of the suite `camera`: the paper's two curves."""

import os
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from pushgraph.evaluation.camera import AFTER_CONTACT, MODELS, OBSERVED, CameraErrors
from pushgraph.evaluation.figures import save_figure

COLOURS = {"true_joints": "#202020", "believed_joints": "#2060c0"}
PUBLISHED = {"true_joints": {0: 6.5, 4: 4.0}, "believed_joints": {0: 8.5, 4: 6.5}}
"""What the paper's predecessor states (cm), on recordings of a real robot."""


def save_camera_curves(scenes: Sequence[CameraErrors], path: str | os.PathLike) -> None:
    """Final error from first contact on, beside what is published, and over observed frames; standard error shaded."""
    figure = Figure(figsize=(10, 4), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    split = len(AFTER_CONTACT)
    for model in MODELS:
        errors = 100 * np.stack([scene.errors[model] for scene in scenes])
        mean = errors.mean(0)
        spread = errors.std(0, ddof=1) / np.sqrt(len(errors)) if len(errors) > 1 else np.zeros_like(mean)
        for axes, frames, part in zip(
            panels, (np.arange(split), np.array(OBSERVED)), (slice(split), slice(split, None)), strict=True
        ):
            (line,) = axes.plot(frames, mean[part], color=COLOURS[model], label=model.replace("_", " "))
            low, high = mean[part] - spread[part], mean[part] + spread[part]
            axes.fill_between(frames, low, high, color=line.get_color(), alpha=0.2, linewidth=0)
        published = PUBLISHED[model]
        label = f"{model.replace('_', ' ')}, predecessor, real robot"
        panels[0].plot(*zip(*published.items(), strict=True), "x", color=COLOURS[model], label=label)
    motion = 100 * np.mean([scene.motion for scene in scenes])
    panels[0].set(xlabel="frames after first contact", ylabel="final error (cm)", xticks=range(split))
    panels[1].set(xlabel="observed frames", title=f"{len(scenes)} recordings, bodies move {motion:.1f} cm")
    for axes in panels:
        axes.grid(alpha=0.3)
        axes.set_ylim(bottom=0)
    panels[0].legend(frameon=False, fontsize=8)
    save_figure(figure, path)
