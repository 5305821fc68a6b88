"""From a scene to the photograph."""

from .exposure import expose
from .linear import LinearPhoto, cloth, draw
from .photo import Photo
from .ruler import RulerScene
from .ruler_face import Ruler
from .scene import Scene
from .through_lens import through_lens
from .true_figures import true_figures
from .truth import RulerTruth, Truth
from .world import World


def render(scene: Scene, seed: int) -> Photo[Truth]:
    """The photograph of a scene, with the truth beside it.

    Args:
        scene: the scene; its muscle's own `weave_seed` draws the braid.
        seed: of the noise.
    """
    return expose(render_linear(scene), seed)


def render_linear(scene: Scene) -> LinearPhoto[Truth]:
    """The light on the sensor. Take it once where only sensor, file or noise are to vary.

    Every pixel is one ray; those near an edge are the mean of 55, so that the light in them is that
    of the surface in them to 0.01 px.
    """
    if scene.muscle is None:
        return LinearPhoto(scene, through_lens(cloth(scene), scene.lens), None)
    world = World(scene.muscle, scene.light, scene.camera)
    return LinearPhoto(scene, draw(world, scene), true_figures(world))


def render_ruler(scene: RulerScene, seed: int) -> Photo[RulerTruth]:
    """The photograph of a ruler, with the truth beside it.

    Args:
        scene: the ruler.
        seed: of the noise.
    """
    ruler = Ruler(scene)
    return expose(LinearPhoto(scene, draw(ruler, scene), ruler.truth()), seed)
