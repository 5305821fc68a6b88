"""From a scene to the photograph."""

from ._expose import expose
from ._linear import LinearPhoto, cloth, draw
from ._photo import Photo
from ._ruler import RulerScene
from ._ruler_face import Ruler
from ._scene import Scene
from ._through_lens import through_lens
from ._true_figures import true_figures
from ._truth import RulerTruth, Truth
from ._world import World


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
