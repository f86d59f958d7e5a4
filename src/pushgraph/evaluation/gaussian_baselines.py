"""What one would write instead of adapting: a Gaussian process on pushes, alone or on another model's errors."""

import warnings

import numpy as np
from jaxtyping import Float, Int

from pushgraph import pose
from pushgraph.adaptation.prediction import contact_points
from pushgraph.extras import extra
from pushgraph.real_pushes import RealPushes

UNITS = np.array([1e-2, 1e-2, 0.2])
"""Values are counted in these (m, m, rad)."""


def gaussian_ends(
    pushes: RealPushes, learnt_from: Int[np.ndarray, " some"], asked: Int[np.ndarray, " others"], base: str | None
) -> Float[np.ndarray, "others 3"]:
    """Final poses in the world by regression on where the probe touches and goes, in the object's frame.

    base: a model that states final poses, whose errors are learnt; None: the motion itself.
    """
    with extra("real", "gp, a baseline of real pushes,"):
        from sklearn.exceptions import ConvergenceWarning
        from sklearn.gaussian_process import GaussianProcessRegressor
        from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
    touch = contact_points(pushes)
    places = np.concatenate((touch / 0.03, (pushes.end_in_body - touch) / 0.02), 1)
    stated = np.zeros((len(pushes), 3)) if base is None else pushes.in_body(pushes.stated[base])
    error = pushes.motion - stated
    error[:, 2] = pose.wrap_angle(error[:, 2])
    found = stated[asked].copy()
    for column, unit in enumerate(UNITS):
        kernel = ConstantKernel(1.0) * RBF(np.full(places.shape[1], 2.0)) + WhiteKernel(0.1)
        process = GaussianProcessRegressor(kernel, normalize_y=True, random_state=0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)
            process.fit(places[learnt_from], error[learnt_from, column] / unit)
        found[:, column] += process.predict(places[asked]) * unit
    return pose.compose(pushes.before[asked], found)
