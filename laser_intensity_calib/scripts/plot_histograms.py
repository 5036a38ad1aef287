#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Draws the histograms of reflectivity that rosbag_tests' evaluate_calibration --histograms writes, one row for each file,
one column for each model (thesis, Fig. 3.4)."""
import argparse
import csv
import sys

try:
    import matplotlib
    matplotlib.use('Agg')
    import matplotlib.pyplot as plt
except ImportError as error:
    missing = error  # said after --help
else:
    missing = None

MODELS = {'raw': 'raw intensities', 'range': 'model of range', 'lut': 'lookup table'}
COLORS = ('#0072b2', '#e69f00', '#009e73', '#cc79a7', '#56b4e9', '#d55e00', '#f0e442', '0.5')


def read(path):
    """(surface, model) -> (reflectivities, shares)."""
    curves = {}
    with open(path) as file:
        for row in csv.DictReader(file):
            x, y = curves.setdefault((row['surface'], row['model']), ([], []))
            x.append(float(row['reflectivity']))
            y.append(100.0 * float(row['share']))
    return curves


def input_of(text):
    title, separator, path = text.partition('=')
    if not separator:
        raise argparse.ArgumentTypeError('%s is not of the form TITLE=FILE.csv' % text)
    return title, path


def draw(out, files):
    figure, axes = plt.subplots(len(files), len(MODELS), figsize=(11, 0.6 + 2.8 * len(files)), squeeze=False, sharex=True)
    for row, (title, curves) in zip(axes, files):
        surfaces = sorted({surface for surface, _ in curves})
        for i, surface in enumerate(surfaces):
            for cell, model in zip(row, MODELS):
                x, y = curves.get((surface, model), ([], []))
                cell.fill_between(x, y, step='mid', alpha=0.6, color=COLORS[i % len(COLORS)], label=surface)
        for cell, model in zip(row, MODELS):
            cell.set(title='%s, %s' % (title, MODELS[model]), ylim=(0, None))
        row[0].set_ylabel('share of the samples (%)')
        row[0].legend(fontsize=8)
    for cell in axes[-1]:
        cell.set_xlabel('reflectivity / that of the reference')
    figure.suptitle('Reflectivities of surfaces by each model')
    figure.tight_layout(rect=(0, 0, 1, 0.97))
    figure.savefig(out, dpi=90)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('out', metavar='OUT.png')
    parser.add_argument('files', nargs='+', type=input_of, metavar='TITLE=FILE.csv')
    arguments = parser.parse_args()
    if missing:
        sys.exit('plot_histograms.py: %s: install python3-matplotlib' % missing)
    try:
        draw(arguments.out, [(title, read(path)) for title, path in arguments.files])
    except (OSError, KeyError, ValueError) as problem:
        sys.exit('plot_histograms.py: %s' % problem)


if __name__ == '__main__':
    main()
