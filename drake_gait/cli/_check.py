"""The work of `check`: stand a robot up, show it, and tell of it."""

import argparse
import sys

from drake_gait.cli._table import show
from drake_gait.files.destination import write
from drake_gait.gait import STANDING
from drake_gait.problem import Candidate
from drake_gait.report.standing import box, loads, study_to_begin_with, suggestions, survey
from drake_gait.robot.description import RobotModel
from drake_gait.simulation.stand_up import stand_up
from drake_gait.visualization.recording import record
from drake_gait.walk import WalkSettings


def work(options: argparse.Namespace, model: RobotModel) -> None:
    """Do what the command line says."""
    stood = stand_up(WalkSettings(model=model))
    for table in (survey(stood), loads(stood), suggestions(stood)):
        show(table)
        print()
    print(f"{box(stood)}\n")
    caption = f"{model.robot.name} stands"
    record(stood.walk, Candidate(gait=STANDING), options.out, model=model, caption=caption)
    print(options.out)
    if options.study is not None:
        write(options.study, study_to_begin_with(stood, options.robot, options.model))
        print(options.study)
    weak = [one.joint for one in stood.servos if abs(one.torque) > 0.5 * one.stall]
    if weak:
        print(
            f"standing takes more than half of the stall torque of {', '.join(weak)}; walking "
            "takes about twice as much",
            file=sys.stderr,
        )
