#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Draws a calibration: intensity over range and over the angle of incidence (thesis, Fig. 3.2), the surface of the lookup
table (Fig. 3.3), and what the models leave unexplained, as calibration.png in the folder of the report."""
import argparse
import csv
import pathlib
import sys

try:
    import matplotlib
    matplotlib.use('Agg')
    import matplotlib.pyplot as plt
    from mpl_toolkits.mplot3d import Axes3D  # noqa: F401  projection='3d' of older releases
    import numpy as np
    import yaml
except ImportError as error:
    missing = error  # said after --help
else:
    missing = None

COLORS = ('#0072b2', '#d55e00', '#009e73', '#cc79a7')


def read_csv(path):
    with open(str(path)) as file:
        rows = list(csv.DictReader(file))
    return {key: np.array([float(row[key] or 'nan') for row in rows]) for key in rows[0]}


class Table:
    """f(r, alpha) as in the file."""

    def __init__(self, table):
        self.values = np.array(table['intensity'], dtype=float)
        self.range, self.incidence = (self.nodes(table[key]) for key in ('range', 'incidence_deg'))

    @staticmethod
    def nodes(axis):
        return axis['min'] + axis['step'] * np.arange(axis['count'])


def polynomial(model, r):
    low, high = model['range']
    t = (2 * r - low - high) / (high - low)
    return sum(c * t**k for k, c in enumerate(model['coefficients']))


def draw_over_range(axes, calibration, cells, table):
    near = cells['incidence_deg'] < 15
    axes.plot(cells['range'][near], cells['intensity'][near], '.', ms=3, color='0.7', label='samples below 15 deg')
    if table:
        column = min(np.searchsorted(table.incidence, 5), len(table.incidence) - 1)
        axes.plot(table.range, table.values[:, column], color=COLORS[0], label='table at %.0f deg' % table.incidence[column])
    if 'polynomial' in calibration:
        r = np.linspace(*calibration['polynomial']['range'], 200)
        axes.plot(r, polynomial(calibration['polynomial'], r), '--', color=COLORS[1],
                  label='polynomial of degree %d' % (len(calibration['polynomial']['coefficients']) - 1))
    axes.set(xlabel='range r (m)', ylabel='intensity', title='Intensity over range', ylim=(0, None))
    axes.legend(fontsize=8)


def draw_over_incidence(axes, cells, table):
    axes.plot(np.arange(0, 91), np.cos(np.radians(np.arange(0, 91))), ':', color='0.6', label='cos (Lambert)')
    if table:
        column = min(np.searchsorted(table.incidence, 5), len(table.incidence) - 1)
        supported = np.where(np.isfinite(table.values[:, column]))[0]
        rows = np.unique(supported[np.linspace(0, len(supported) - 1, 6).astype(int)[1:-1]]) if len(supported) else []
        for row, color in zip(rows, COLORS):
            curve = table.values[row]
            first = np.isfinite(curve).argmax()
            axes.plot(table.incidence, curve / curve[first], color=color, label='table at %.1f m' % table.range[row])
    axes.set(xlabel='angle of incidence (deg)', ylabel='intensity / that at the least angle',
             title='Intensity over the angle of incidence', xlim=(0, 90), ylim=(0, 1.2))
    axes.legend(fontsize=8)


def draw_surface(figure, position, table):
    axes = figure.add_subplot(position, projection='3d')
    r, alpha = np.meshgrid(table.range, table.incidence, indexing='ij')
    known = np.isfinite(table.values)
    axes.plot_surface(r, alpha, table.values, cmap='viridis', rcount=80, ccount=60, linewidth=0,
                      vmin=np.nanmin(table.values), vmax=np.nanmax(table.values))
    axes.set(xlabel='range r (m)', ylabel='incidence (deg)', title='Lookup table',
             xlim=(0, r[known].max()), ylim=(0, alpha[known].max()), zlim=(0, None))
    axes.set_zlabel('intensity', labelpad=10)
    axes.view_init(30, -120)


def draw_residuals(axes, samples):
    bins = np.linspace(0, 2.5, 126)
    models = (('raw', 'raw intensities'), ('range_model', 'model of range'), ('lut', 'lookup table'))
    for (key, name), color in zip(models, ('0.5', COLORS[1], COLORS[0])):
        ratio = samples[key][np.isfinite(samples[key])]
        if len(ratio):
            axes.hist(ratio, bins, histtype='step', density=True, color=color,
                      label='%s: %.3f' % (name, ratio.std()))
    axes.set(xlabel='intensity of the reference surface / model', ylabel='density of the samples',
             title='What the models leave', xlim=(bins[0], bins[-1]))
    axes.legend(fontsize=8, loc='center right', title='standard deviation')


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('calibration', help='file that calibrate --out has written')
    parser.add_argument('folder', type=pathlib.Path, help='that calibrate --report has written')
    arguments = parser.parse_args()
    if missing:
        sys.exit('plot_calibration.py: %s: install python3-matplotlib and python3-yaml' % missing)
    try:
        with open(arguments.calibration) as file:
            calibration = yaml.load(file, getattr(yaml, 'CSafeLoader', yaml.SafeLoader))
        cells, samples = (read_csv(arguments.folder / name) for name in ('cells.csv', 'samples.csv'))
    except (OSError, yaml.YAMLError) as problem:
        sys.exit('plot_calibration.py: %s' % problem)
    table = Table(calibration['table']) if 'table' in calibration else None
    figure = plt.figure(figsize=(11, 8))
    draw_over_range(figure.add_subplot(221), calibration, cells, table)
    draw_over_incidence(figure.add_subplot(222), cells, table)
    if table:
        draw_surface(figure, 223, table)
    draw_residuals(figure.add_subplot(224), samples)
    figure.suptitle('Intensities of %s, reference surface: %s' % (calibration['scanner'], calibration['reference']))
    figure.tight_layout(rect=(0, 0, 1, 0.98))
    figure.savefig(str(arguments.folder / 'calibration.png'), dpi=90)


if __name__ == '__main__':
    main()
