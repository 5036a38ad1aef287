#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Plots the errors that relations_metric and trajectory_error wrote with --json, as the thesis's Fig. 3.7 b and c.

Usage: plot_evaluation.py OUT.png NAME=FILE.json [NAME=FILE.json ...]
"""
import json
import math
import sys

import matplotlib
matplotlib.use('Agg')
from matplotlib import pyplot  # noqa: E402


def read(argument):
    """[(label, errors)] of one NAME=FILE."""
    name, _, path = argument.rpartition('=')
    with open(path) as file:
        metrics = json.load(file)
    return [((name or path) + ', ' + metric, values['errors']) for metric, values in metrics.items()]


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    curves = [curve for argument in sys.argv[2:] for curve in read(argument)]
    figure, axes = pyplot.subplots(2, 2, figsize=(13, 8), gridspec_kw={'width_ratios': [2, 1]})
    for (over_time, sorted_axis), key, label, scale in (
            (axes[0], 'translation_m', 'translation (m)', 1.0),
            (axes[1], 'rotation_rad', 'rotation (deg)', 180.0 / math.pi)):
        for name, errors in curves:
            values = [scale * value for value in errors[key]]
            start = min(errors['time_s'], default=0.0)
            over_time.plot([t - start for t in errors['time_s']], values, '.', markersize=2, label=name)
            sorted_axis.plot([100.0 * (i + 1) / len(values) for i in range(len(values))], sorted(values), label=name)
        over_time.set_xlabel('time (s)')
        over_time.set_ylabel('error of the ' + label)
        sorted_axis.set_xlabel('share of the errors that are smaller (%)')
        for axis in (over_time, sorted_axis):
            axis.set_yscale('symlog', linthresh=1e-3)
            axis.grid(True, alpha=0.3)
        sorted_axis.legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(sys.argv[1], dpi=110)


if __name__ == '__main__':
    main()
