"""Kriging: Gaussian processes of what walks leave to be explained.

They tell near what was simulated what lies there, and say nothing far from it.
"""

import numpy as np
from scipy.linalg import cho_solve
from scipy.optimize import minimize
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, Kernel, Matern, WhiteKernel

from drake_gait.gait import FloatArray

_KERNEL_WALKS = 256


class ErrorProcess:
    """A Gaussian process of the errors that a model made at points it had not seen.

    Args:
        x: The points, shape (n, d).
        errors: What the model lacked there, shape (n,).
    """

    def __init__(self, x: FloatArray, errors: FloatArray) -> None:
        self._scale = float(errors.std())
        self.deviation = self._scale
        """Standard deviation of what is left at a point not seen: Rasmussen and Williams 2006, Eq.
        5.12, over all points left out one by one."""
        self._process: GaussianProcessRegressor | None = None
        if self._scale == 0.0:
            return
        standard = errors / self._scale
        process = GaussianProcessRegressor(fitted_kernel(x, standard), optimizer=None)
        try:
            self._process = process.fit(x, standard)
        except np.linalg.LinAlgError:  # Points too close together: the errors are left as they are.
            return
        precision = np.diag(cho_solve((process.L_, True), np.eye(len(x))))
        self.deviation *= float(np.std(process.alpha_ / precision))

    def __call__(self, x: FloatArray) -> FloatArray:
        """The error to expect at points of shape (m, d), shape (m,)."""
        if self._process is None:
            return np.zeros(len(x))
        expected: FloatArray = self._scale * self._process.predict(x)
        return expected


def fitted_kernel(x: FloatArray, standard: FloatArray) -> Kernel:
    """A Matérn 5/2 kernel and white noise, for values of about unit variance, shape (n,).

    Its three numbers are those of largest likelihood on at most 256 of the points: three numbers
    hardly tell one walk from the others.
    """
    chosen = np.random.default_rng(len(x)).permutation(len(x))[:_KERNEL_WALKS]
    kernel = ConstantKernel() * Matern(4.0, (0.3, 1e3), nu=2.5) + WhiteKernel(0.1, (1e-5, 1e1))
    process = GaussianProcessRegressor(kernel, optimizer=None).fit(x[chosen], standard[chosen])

    def unlikelihood(theta: FloatArray) -> tuple[float, FloatArray]:
        value, slope = process.log_marginal_likelihood(
            theta, eval_gradient=True, clone_kernel=False
        )
        return -value, -slope

    # The regressor's own search warns where the best length is the longest, as of pure noise it
    # should be, and warnings cannot be silenced for one thread alone.
    found = minimize(unlikelihood, kernel.theta, jac=True, method="L-BFGS-B", bounds=kernel.bounds)
    return kernel.clone_with_theta(found.x)
