"""What is concluded from refined parameters: inliers, the vote on the sign, F."""

from typing import NamedTuple

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.estimators.machinery.gaussian import undetermined


class Conclusion(NamedTuple):
    """
    Geometries of pairs of views: parameters, (..., P), and their covariance, (..., P, P).

    ``determined``, (...), says where the matches fix the bearings; ``inliers``, (..., N), agree
    with them; ``balance``, (...), of the cheirality vote is negative where psi and phi are those
    of the reverse baseline; ``fundamental``, (..., 3, 3), has the sign of the vote.
    """

    parameters: FloatArray
    covariance: FloatArray
    determined: BoolArray
    inliers: BoolArray
    balance: FloatArray
    fundamental: FloatArray

    def rows(self) -> list['Conclusion']:
        """Return many geometries, shape (B,), one by one."""
        return [Conclusion(*row) for row in zip(*self, strict=True)]

    def require_determined(self) -> None:
        """Raise DegenerateGeometryError where one geometry is not determined."""
        if not self.determined:
            raise undetermined()
