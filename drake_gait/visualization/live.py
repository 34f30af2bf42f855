"""A walk while it is simulated, in every browser that is connected to Meshcat."""

import time

import numpy as np
from pydrake.geometry import Meshcat, MeshcatVisualizer, MeshcatVisualizerParams
from pydrake.systems.framework import DiagramBuilder

from drake_gait.foot import FootDesign
from drake_gait.gait import FRAME_TIME, FloatArray
from drake_gait.robot.description import Model
from drake_gait.simulation.messages import default_context
from drake_gait.simulation.plant import add_robot
from drake_gait.simulation.plant_config import PlantConfig
from drake_gait.visualization.meshcat import (
    draw_ground,
    draws,
    place_camera,
    set_lights,
    shown,
)

_GROUND = np.array([-0.2, -0.3]), np.array([0.8, 0.3])  # most walks end on it [m]


class Screen:
    """Shows a robot on its ground; `show` is what `simulate` takes as its `watch`.

    It belongs to the thread of its Meshcat, `scene.with_meshcat`.
    """

    def __init__(self, meshcat: Meshcat, model: Model, foot: FootDesign) -> None:
        builder = DiagramBuilder()
        self._plant, scene_graph = add_robot(builder, PlantConfig(model=model, foot=foot))
        parameters = MeshcatVisualizerParams(prefix="robot", publish_period=FRAME_TIME)
        MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat, parameters)
        self._diagram = draws(builder.Build())
        self._context = default_context(self._diagram)
        self._begun: float | None = None
        set_lights(meshcat)
        draw_ground(meshcat, *_GROUND)
        height = shown(self._plant, scene_graph, model).height
        place_camera(meshcat, [*_GROUND[0], 0.0], [*_GROUND[1], height])

    def show(self, instant: float, positions: FloatArray) -> None:
        """Show the robot, not before its instant [s] has come: never faster than real time."""
        if self._begun is None:
            self._begun = time.monotonic() - instant
        time.sleep(max(0.0, self._begun + instant - time.monotonic()))
        self._context.SetTime(instant)
        plant_context = self._plant.GetMyMutableContextFromRoot(self._context)
        self._plant.SetPositions(plant_context, positions)
        self._diagram.ForcedPublish(self._context)
