"""The image of an ideal pinhole: rasterized, textured, its edges smoothed; by one core or two."""

import numpy as np

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.simulation.rendering.assistant import Assistant
from visual_servo_epipolar.simulation.rendering.edges import mixing, smooth_edges
from visual_servo_epipolar.simulation.rendering.raster import rasterize, View
from visual_servo_epipolar.simulation.rendering.sampling import shade, textured
from visual_servo_epipolar.simulation.rendering.sharing import ASSISTANT, MAIN
from visual_servo_epipolar.simulation.rendering.surfaces import Scene


def draw(scene: Scene, view: View, assistant: Assistant | None = None) -> Image:
    """Return the image of ``scene``, shape (H, W), the same to the last bit with an assistant."""
    if assistant is None or not assistant.begin(view):
        return shade(scene, view, rasterize(scene, view))
    raster = rasterize(scene, view)
    edges = mixing(scene, view, raster)  # first, while the raster is in the cache
    image: Image = np.zeros((view.height, view.width), dtype=np.uint8)
    numbers = assistant.shares(raster)
    textured(scene, raster, image, numbers[MAIN])
    if not assistant.finish(image):
        textured(scene, raster, image, numbers[ASSISTANT])
    smooth_edges(image, edges)
    return image
