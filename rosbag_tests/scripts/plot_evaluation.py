#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Draws trajectories with their errors (thesis, Fig. 3.7) and maps side by side (Fig. 3.6).

  plot_evaluation.py FOLDER                   what evaluate_slam --out has written there: for each scenario
                                              SCENARIO-errors.png and SCENARIO-maps.png
  plot_evaluation.py OUT.png NAME=FILE.json [NAME=FILE.json ...]
                                              what relations_metric and trajectory_error --json have written
"""
import argparse
import itertools
import json
import math
import pathlib
import sys

try:
    import matplotlib
    matplotlib.use('Agg')
    from matplotlib import cm, colors, patches, pyplot
    import numpy
except ImportError as error:
    missing = error  # said after --help
else:
    missing = None

COLORS = ('#d55e00', '#0072b2', '#009e73', '#cc79a7', '#e69f00', '#56b4e9', '#000000')  # of costs, in order
UNKNOWN = '#bebebe'  # as evaluate_slam draws it
ROTATION = ('rotation_rad', 'rotation (deg)', 180.0 / math.pi)
METRES = (('translation_m', 'translation (m)', 1.0), ROTATION)
MILLIMETRES = (('translation_m', 'translation (mm)', 1e3), ROTATION)


def fail(text):
    sys.exit('plot_evaluation.py: ' + text)


def read(path):
    try:
        return json.loads(pathlib.Path(path).read_text())
    except (OSError, ValueError) as problem:
        fail('%s: %s' % (path, problem))


def curves_of(argument):
    """[(label, errors)] of one NAME=FILE."""
    name, _, path = argument.rpartition('=')
    return [('%s, %s' % (name or path, metric), values['errors']) for metric, values in read(path).items()
            if isinstance(values, dict) and 'errors' in values]


def plot_files(out, arguments):
    curves = [curve for argument in arguments for curve in curves_of(argument)]
    figure, axes = pyplot.subplots(2, 2, figsize=(13, 8), gridspec_kw={'width_ratios': [2, 1]}, sharey='row')
    of_curves = pyplot.get_cmap('viridis')(numpy.linspace(0.0, 0.9, len(curves)))
    for (over_time, in_order), (key, label, scale) in zip(axes, METRES):
        for (name, errors), color in zip(curves, of_curves):
            values = scale * numpy.array(errors[key])
            time = numpy.array(errors['time_s'])
            over_time.plot(time - time[:1], values, '.', markersize=2, color=color)
            in_order.plot(100.0 * numpy.arange(1, len(values) + 1) / max(1, len(values)), numpy.sort(values), color=color,
                          label=name)
        over_time.set_ylabel('error of the ' + label)
        for axis in (over_time, in_order):
            axis.set_yscale('symlog', linthresh=1e-3)
            axis.set_ylim(bottom=0.0)
            axis.grid(True, alpha=0.3)
    axes[1][0].set_xlabel('time (s)')
    axes[1][1].set_xlabel('share of the errors that are smaller (%)')
    axes[0][0].set_title('Over time')
    axes[0][1].set_title('In order of size')
    figure.suptitle('Errors of the poses')
    figure.legend(*axes[0][1].get_legend_handles_labels(), loc='lower center', ncol=3, fontsize=8)
    figure.tight_layout(rect=(0, 0.01 + 0.025 * ((len(curves) + 2) // 3), 1, 1))
    figure.savefig(str(out), dpi=110)


def smooth(values, window):
    """Mean over a window, shorter at both ends."""
    kernel = numpy.ones(min(window, len(values)))
    return numpy.convolve(values, kernel, 'same') / numpy.convolve(numpy.ones(len(values)), kernel, 'same')


class Scenario:
    """What evaluate_slam has written of the first drive of a scenario."""

    def __init__(self, folder, name):
        self.path = lambda suffix: folder / (name + '-' + suffix)
        self.name = name
        runs = read(folder / 'evaluation.json')
        self.costs = list(dict.fromkeys(run['cost'] for run in runs if run['scenario'] == name))
        self.colors = dict(zip(self.costs, itertools.cycle(COLORS)))
        self.truth = numpy.loadtxt(str(self.path('truth.tum')), ndmin=2)
        self.estimates = {cost: numpy.loadtxt(str(self.path(cost + '.tum')), ndmin=2) for cost in self.costs}
        self.runs = {cost: read(self.path(cost + '.json')) for cost in self.costs}

    def outcome(self, cost):
        run = self.runs[cost]
        if run['lost_after_s'] is not None:
            return 'map lost after %.1f s' % run['lost_after_s']
        return 'mean error %.0f mm' % (1e3 * run['absolute']['translation_m']['mean'])

    def in_map(self, points):
        """Of the frame of the truth, n x 2, in the frame of the map, which begins at the first pose."""
        _, x, y, _, _, _, qz, qw = self.truth[0]
        yaw = 2.0 * math.atan2(qz, qw)
        rotation = numpy.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
        return (points - [x, y]) @ rotation


def plot_errors(scenario):
    """The trajectories and, over time, the errors from scan to scan: dots, and the mean over a second."""
    figure = pyplot.figure(figsize=(12, 5))
    grid = figure.add_gridspec(2, 2, width_ratios=[2, 3])
    trajectories = figure.add_subplot(grid[:, 0])
    rows = [figure.add_subplot(grid[i, 1]) for i in range(2)]
    truth = scenario.truth
    lowest = {}
    for cost in scenario.costs:
        estimate = scenario.estimates[cost]
        trajectories.plot(estimate[:, 1], estimate[:, 2], color=scenario.colors[cost], linewidth=1.2,
                          label='%s, %s' % (cost, scenario.outcome(cost)))
        errors = scenario.runs[cost]['delta']['errors']
        time = numpy.array(errors['time_s']) - truth[0, 0]
        a_second = max(1, int(round(len(time) / (time[-1] - time[0]))))
        for axis, (key, label, scale) in zip(rows, MILLIMETRES):
            values = scale * numpy.array(errors[key])
            axis.plot(time, values, ',', color=scenario.colors[cost], alpha=0.4)
            axis.plot(time, smooth(values, a_second), color=scenario.colors[cost], linewidth=1.2)
            axis.set_ylabel(label)
            lowest[key] = min(lowest.get(key, math.inf), numpy.quantile(values, 0.1))
    for axis, (key, _, _) in zip(rows, MILLIMETRES):
        axis.set_yscale('log')  # where a map is lost, all else would be too small
        axis.set_ylim(bottom=0.5 * lowest[key])
        axis.grid(True, alpha=0.3)
    trajectories.plot(truth[:, 1], truth[:, 2], 'k--', linewidth=0.8, label='truth')
    trajectories.set(aspect='equal', adjustable='datalim', xlabel='x (m)', ylabel='y (m)', title='Trajectories')
    rows[0].set_title('Error from scan to scan: each scan (dots), mean over 1 s (lines)')
    rows[1].set_xlabel('time (s)')
    figure.suptitle('SLAM in the simulated scenario "%s" by each cost' % scenario.name)
    figure.legend(*trajectories.get_legend_handles_labels(), loc='lower center', ncol=5)
    figure.tight_layout(rect=(0, 0.06, 1, 0.98))
    figure.savefig(str(scenario.path('errors.png')), dpi=90)
    pyplot.close(figure)


def read_picture(path):
    """Pixels of a PPM file."""
    magic, size, depth, pixels = path.read_bytes().split(b'\n', 3)
    if magic != b'P6' or depth != b'255':
        fail('%s is no picture of evaluate_slam' % path)
    width, height = (int(number) for number in size.split())
    return numpy.frombuffer(pixels, numpy.uint8).reshape(height, width, 3)


def reflectivity_colors():
    """As evaluate_slam colours cells: hue from blue (0) over green to red (1)."""
    return colors.LinearSegmentedColormap.from_list(
        'reflectivity', [(0, 0, 1), (0, 1, 1), (0, 1, 0), (1, 1, 0), (1, 0, 0)])


def plot_maps(scenario):
    """The map of each cost, and over it what is true."""
    count = len(scenario.costs)
    figure, axes = pyplot.subplots(1, count + 1, figsize=(4.2 * count + 0.9, 5.4),
                                   gridspec_kw={'width_ratios': [1.0] * count + [0.04]})
    seen = scenario.in_map(numpy.loadtxt(str(scenario.path('seen.csv')), delimiter=',', skiprows=1, ndmin=2))
    truth = scenario.in_map(scenario.truth[:, 1:3])
    for axis, cost in zip(axes, scenario.costs):
        pixels, place = read_picture(scenario.path(cost + '.ppm')), scenario.runs[cost]['map']
        resolution, left, bottom = place['resolution'], place['x'], place['y']
        height, width = (resolution * size for size in pixels.shape[:2])
        axis.set_facecolor(UNKNOWN)
        axis.imshow(pixels, extent=(left, left + width, bottom, bottom + height))
        axis.plot(seen[:, 0], seen[:, 1], '.', color='black', markersize=1.5, label='true walls')
        # Cells are smaller than what can be seen of a room in this picture.
        rows, columns = numpy.nonzero((pixels != pixels[..., :1]).any(axis=2) | (pixels == 0).all(axis=2))
        axis.scatter(left + resolution * (columns + 0.5), bottom + height - resolution * (rows + 0.5), s=2.5, linewidths=0,
                     c=pixels[rows, columns] / 255.0, zorder=2)
        estimate = scenario.in_map(scenario.estimates[cost][:, 1:3])
        axis.plot(truth[:, 0], truth[:, 1], 'k', linewidth=1.2, label='true trajectory')
        axis.plot(estimate[:, 0], estimate[:, 1], '--', color='magenta', linewidth=1.2, label='estimated trajectory')
        lost = scenario.runs[cost]['lost_after_s'] is not None
        axis.set_title('%s\n%s' % (cost, scenario.outcome(cost)), color='#c00000' if lost else 'black')
        axis.set_xlabel('x (m)')
    limits = numpy.array([axis.axis() for axis in axes[:-1]])
    for axis in axes[:-1]:
        axis.set(xlim=(limits[:, 0].min(), limits[:, 1].max()), ylim=(limits[:, 2].min(), limits[:, 3].max()))
    axes[0].set_ylabel('y (m)')
    handles, labels = axes[0].get_legend_handles_labels()
    for color, label in (('white', 'free'), (UNKNOWN, 'unknown')):
        handles.append(patches.Patch(facecolor=color, edgecolor='black', linewidth=0.5))
        labels.append(label)
    figure.colorbar(cm.ScalarMappable(cmap=reflectivity_colors()), cax=axes[-1], label='reflectivity of occupied cells')
    figure.suptitle('Maps of the simulated scenario "%s" by each cost' % scenario.name)
    figure.legend(handles, labels, loc='lower center', ncol=5, markerscale=5)
    figure.tight_layout(rect=(0, 0.07, 1, 0.97))
    figure.savefig(str(scenario.path('maps.png')), dpi=90)
    pyplot.close(figure)


def plot_folder(folder):
    names = sorted(path.name[:-len('-truth.tum')] for path in folder.glob('*-truth.tum'))
    if not names:
        fail('%s has no SCENARIO-truth.tum: is it what evaluate_slam --out has written?' % folder)
    for name in names:
        scenario = Scenario(folder, name)
        plot_errors(scenario)
        plot_maps(scenario)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('target', type=pathlib.Path, metavar='FOLDER | OUT.png')
    parser.add_argument('files', nargs='*', metavar='NAME=FILE.json')
    arguments = parser.parse_args()
    if missing:
        fail('%s: install python3-matplotlib' % missing)
    if arguments.files:
        plot_files(arguments.target, arguments.files)
    elif arguments.target.is_dir():
        plot_folder(arguments.target)
    else:
        parser.error('there is no folder %s, nor is there a FILE.json after it' % arguments.target)


if __name__ == '__main__':
    main()
