"""How far each method that samples is from the reference, on a sphere under a gradient."""

from functools import cache

from glossbench.envmap.lights.synthetic import Gradient
from glossbench.methods.environment_sampling import EnvironmentSampling
from glossbench.methods.filtered_importance_sampling import FilteredImportanceSampling
from glossbench.methods.importance_sampling import ImportanceSampling
from glossbench.methods.regular_sampling import RegularSampling
from glossbench.scene.sphere import Sphere
from glossbench.shading.image import shade
from glossbench.truth.reference import compute_reference

METHODS = {
    "regular_sampling": RegularSampling(samples=271, xi=1e-3, normalisation="exact"),
    "filtered_importance_sampling": FilteredImportanceSampling(samples=256),
    "importance_sampling": ImportanceSampling(samples=256),
    "environment_sampling": EnvironmentSampling(samples=4096),
}


@cache
def method_images(material):
    """Truth (P, 3), each method's image and n . wo (P,) of the pixels of a sphere of 16 by 16."""
    light, view = Gradient(resolution=32).cubemap(), Sphere(resolution=16)
    truth = compute_reference(light, material, view, relative_error=2e-3)
    images = {
        name: shade(method, light, material, view, time_it=False).radiance[truth.mask].double()
        for name, method in METHODS.items()
    }
    return truth.radiance[truth.mask], images, view.points().n.z


def method_errors(material, cos_o=0.0):
    """RMS over the mean of each method's image, where the view is not as grazing."""
    truth, images, cosine = method_images(material)
    facing = cosine > cos_o
    return {
        name: float((image - truth)[facing].square().mean().sqrt() / truth[facing].mean())
        for name, image in images.items()
    }


def check_methods(errors, limits):
    assert all(errors[name] <= limits[name] for name in METHODS), errors


def limits(regular, filtered, importance, environment):
    return dict(zip(METHODS, (regular, filtered, importance, environment), strict=True))
