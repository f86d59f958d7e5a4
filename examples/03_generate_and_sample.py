"""Generate a small dataset and draw training windows from it.

python examples/03_generate_and_sample.py
"""

import numpy as np

import pushgraph as pg


def main() -> None:
    """Sixteen trajectories of three objects, then a batch of windows of six frames of one push each."""
    path = pg.generate("multiple-parts", objects=3, count=16, seed=0, out="small.h5")
    with pg.Dataset(path) as dataset:
        track = dataset[0]
        print(f"trajectory 0: {len(track.times)} frames, {len(track.scene.joints)} joints, {dataset.density[0]}")
        sampler = pg.WindowSampler(dataset, frames=6, batch=256, seed=0)
        batch = sampler.batch(step=0)
        motion = np.hypot(*np.moveaxis(np.diff(batch.poses[..., :2], axis=1), -1, 0))
        print(f"{batch.poses.shape} poses; the robot moves {100 * motion[:, :, 0].mean():.2f} cm a frame")


if __name__ == "__main__":
    main()
