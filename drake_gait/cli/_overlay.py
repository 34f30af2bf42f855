"""The work of `overlay`: walk again, compare, draw."""

import argparse
import sys
from dataclasses import replace

import numpy as np

from drake_gait.cli._replay import choose
from drake_gait.cli._table import show
from drake_gait.errors import StudyError
from drake_gait.hardware.joint_log import agreement, read_joint_log
from drake_gait.report.result import in_words
from drake_gait.report.tables import Table, number
from drake_gait.robot.description import robot_of
from drake_gait.simulation.simulate import simulate
from drake_gait.visualization.walk import joint_angles


def work(options: argparse.Namespace) -> None:
    """Do what the command line says."""
    settings, chosen, as_then = choose(options.run, options.walk)
    log = read_joint_log(options.log, robot_of(as_then.model, as_then.robot))
    log = replace(log, times=log.times + options.shift)
    history = simulate(chosen.candidate, as_then, history=True).history
    if history is None:
        raise StudyError(
            f"walk {chosen.id} of {options.run} has no angles, {in_words(chosen.walk)}; give "
            "another --walk"
        )
    found = agreement(log, history.time, history.angles)
    rows = []
    for one in found:
        rms, aligned = np.degrees([one.rms, one.rms_aligned])
        rows.append([one.joint, number(1e3 * one.delay, 0), number(rms, 2), number(aligned, 2)])
    show(
        Table(
            caption=f"{settings.name}, walk {chosen.id}: measured against simulated",
            columns=["joint", "delay [ms]", "rms [deg]", "rms, delay taken out [deg]"],
            rows=rows,
        )
    )
    if options.out is not None:
        joint_angles(history, log.times, log.angles, options.out)
        print(options.out, file=sys.stderr)
