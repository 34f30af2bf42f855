"""The work of `overlay`: walk again, compare, draw."""

import argparse
import sys
from dataclasses import replace

import numpy as np

from drake_gait.cli._replay import choose
from drake_gait.errors import StudyError
from drake_gait.hardware.joint_log import agreement, read_joint_log
from drake_gait.report.result import in_words
from drake_gait.simulation.simulate import simulate
from drake_gait.visualization.walk import joint_angles


def work(options: argparse.Namespace) -> None:
    """Do what the command line says."""
    log = read_joint_log(options.log)
    log = replace(log, times=log.times + options.shift)
    settings, chosen, as_then = choose(options.run, options.walk)
    history = simulate(chosen.candidate, as_then, history=True).history
    if history is None:
        raise StudyError(
            f"walk {chosen.id} of {options.run} has no angles, {in_words(chosen.walk)}; give "
            "another --walk"
        )
    found = agreement(log, history.time, history.angles)
    print(f"{settings.name}, walk {chosen.id}: measured against simulated")
    print(f"{'joint':<14} {'delay [ms]':>10} {'rms [deg]':>10} {'rms, delay taken out [deg]':>27}")
    for one in found:
        rms, aligned = np.degrees([one.rms, one.rms_aligned])
        print(f"{one.joint:<14} {1e3 * one.delay:>10.0f} {rms:>10.2f} {aligned:>27.2f}")
    if options.out is not None:
        joint_angles(history, log.times, log.angles, options.out)
        print(options.out, file=sys.stderr)
