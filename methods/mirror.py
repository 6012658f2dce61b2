"""A mirror ball: what the light holds in the mirror direction, whatever the material."""

from glossbench.prefilter import METHODS, CubeMap, Material, Method, Radiance, ShadingPoints, Vec3, finest, lookup


@METHODS.register("mirror")
class Mirror(Method):
    """Lo = L(2 (n . v) n - v): the baseline that no material is seen in.

    Source: the reflection mapping of Blinn and Newell 1976.
    """

    equation = "L_o = L(2 (n dot v) n - v)"

    def shade(self, points: ShadingPoints, material: Material, light: CubeMap) -> Radiance:
        """Radiance (P, 3)."""
        cosine = points.n.x * points.wo.x + points.n.y * points.wo.y + points.n.z * points.wo.z
        direction = Vec3(*(2 * cosine * n - v for n, v in zip(points.n, points.wo, strict=True)))
        return lookup(finest(light), direction)
