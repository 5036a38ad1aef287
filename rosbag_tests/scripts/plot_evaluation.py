#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Plots errors of trajectories (thesis, Fig. 3.7) and maps side by side (Fig. 3.6).

Usage: plot_evaluation.py FOLDER                                   that evaluate_slam --out has written: for each
                                                                   scenario SCENARIO-errors.png and SCENARIO-maps.png
       plot_evaluation.py OUT.png NAME=FILE.json [NAME=FILE.json ...]   of relations_metric and trajectory_error --json
"""
import json
import math
import pathlib
import sys

import matplotlib
matplotlib.use('Agg')
from matplotlib import pyplot  # noqa: E402
import numpy  # noqa: E402

COSTS = {'occupancy': 'tab:red', 'reflectivity': 'tab:blue', 'combined': 'tab:green', 'auto': 'tab:orange'}
ROTATION = ('rotation_rad', 'rotation (deg)', 180.0 / math.pi)
METRES = (('translation_m', 'translation (m)', 1.0), ROTATION)
MILLIMETRES = (('translation_m', 'translation (mm)', 1e3), ROTATION)


def read(argument):
    """[(label, errors)] of one NAME=FILE."""
    name, _, path = argument.rpartition('=')
    with open(path) as file:
        metrics = json.load(file)
    return [((name or path) + ', ' + metric, values['errors']) for metric, values in metrics.items()]


def plot_files(out, arguments):
    curves = [curve for argument in arguments for curve in read(argument)]
    figure, axes = pyplot.subplots(2, 2, figsize=(13, 8), gridspec_kw={'width_ratios': [2, 1]})
    for (over_time, sorted_axis), (key, label, scale) in zip(axes, METRES):
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
    figure.savefig(out, dpi=110)


def smooth(values, window):
    """Mean over a window, shorter at both ends."""
    kernel = numpy.ones(min(window, len(values)))
    return numpy.convolve(values, kernel, 'same') / numpy.convolve(numpy.ones(len(values)), kernel, 'same')


def plot_errors(folder, scenario, costs):
    """The ways and, over time, the errors from scan to scan: dots, and the mean over a second."""
    figure = pyplot.figure(figsize=(12, 4.5))
    grid = figure.add_gridspec(2, 2, width_ratios=[2, 3])
    ways = figure.add_subplot(grid[:, 0])
    truth = numpy.loadtxt(folder / (scenario + '-truth.tum'))
    rows = [figure.add_subplot(grid[i, 1]) for i in range(2)]
    lowest = {}
    for cost in costs:
        way = numpy.loadtxt(folder / (scenario + '-' + cost + '.tum'))
        ways.plot(way[:, 1], way[:, 2], color=COSTS[cost], linewidth=1, label=cost)
        with open(folder / (scenario + '-' + cost + '.json')) as file:
            errors = json.load(file)['delta']['errors']
        time = numpy.array(errors['time_s']) - truth[0, 0]
        a_second = max(1, int(round(len(time) / (time[-1] - time[0]))))
        for axis, (key, label, scale) in zip(rows, MILLIMETRES):
            values = scale * numpy.array(errors[key])
            axis.plot(time, values, ',', color=COSTS[cost], alpha=0.4)
            axis.plot(time, smooth(values, a_second), color=COSTS[cost], linewidth=1.2)
            axis.set_ylabel(label, fontsize=8)
            lowest[key] = min(lowest.get(key, math.inf), numpy.quantile(values, 0.1))
    for axis, (key, _, _) in zip(rows, MILLIMETRES):
        axis.set_yscale('log')  # where a map is lost, all else would be too small
        axis.set_ylim(bottom=0.5 * lowest[key])
        axis.grid(True, alpha=0.3)
    ways.plot(truth[:, 1], truth[:, 2], 'k--', linewidth=0.8, label='truth')
    ways.set(aspect='equal', xlabel='x (m)', ylabel='y (m)')
    ways.legend(fontsize=8)
    rows[0].set_title('Error from scan to scan', fontsize=9)
    rows[1].set_xlabel('time (s)')
    figure.tight_layout()
    figure.savefig(folder / (scenario + '-errors.png'), dpi=80)
    pyplot.close(figure)


def read_picture(path):
    """Pixels of a PPM file."""
    magic, size, depth, pixels = path.read_bytes().split(b'\n', 3)
    if magic != b'P6' or depth != b'255':
        sys.exit('%s is no picture of evaluate_slam' % path)
    width, height = (int(number) for number in size.split())
    return numpy.frombuffer(pixels, numpy.uint8).reshape(height, width, 3)


def plot_maps(folder, scenario, costs):
    figure, axes = pyplot.subplots(1, len(costs), figsize=(4.5 * len(costs), 4), squeeze=False)
    for axis, cost in zip(axes[0], costs):
        axis.imshow(read_picture(folder / (scenario + '-' + cost + '.ppm')), interpolation='antialiased')
        axis.set_title(cost)
        axis.set_axis_off()
    figure.tight_layout()
    figure.savefig(folder / (scenario + '-maps.png'), dpi=80)
    pyplot.close(figure)


def plot_folder(folder):
    scenarios = sorted(path.name[:-len('-truth.tum')] for path in folder.glob('*-truth.tum'))
    if not scenarios:
        sys.exit('%s has no SCENARIO-truth.tum: is it what evaluate_slam --out has written?' % folder)
    for scenario in scenarios:
        costs = [cost for cost in COSTS if (folder / (scenario + '-' + cost + '.json')).exists()]
        plot_errors(folder, scenario, costs)
        plot_maps(folder, scenario, costs)


def main():
    if len(sys.argv) == 2 and pathlib.Path(sys.argv[1]).is_dir():
        plot_folder(pathlib.Path(sys.argv[1]))
    elif len(sys.argv) >= 3:
        plot_files(sys.argv[1], sys.argv[2:])
    else:
        sys.exit(__doc__)


if __name__ == '__main__':
    main()
