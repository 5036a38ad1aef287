#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
#
# Draws the histograms of reflectivity that rosbag_tests' evaluate_calibration --histograms writes, one row for each
# file, one column for each model (thesis, Fig. 3.4).
#
#   plot_histograms.py OUT.png TITLE=FILE.csv ...
import csv
import sys

import matplotlib
matplotlib.use('Agg')
import matplotlib.pyplot as plt

MODELS = ('raw', 'range', 'lut')


def read(path):
    """(surface, model) -> (reflectivities, shares)."""
    curves = {}
    with open(path) as file:
        for row in csv.DictReader(file):
            x, y = curves.setdefault((row['surface'], row['model']), ([], []))
            x.append(float(row['reflectivity']))
            y.append(float(row['share']))
    return curves


def main(out, inputs):
    figure, axes = plt.subplots(len(inputs), len(MODELS), figsize=(11, 2.6 * len(inputs)), squeeze=False)
    for row, (title, path) in zip(axes, inputs):
        for (surface, model), (x, y) in sorted(read(path).items()):
            row[MODELS.index(model)].fill_between(x, y, step='mid', alpha=0.5, label=surface)
        for cell, model in zip(row, MODELS):
            cell.set(title='%s, %s' % (title, model), yticks=[], xlabel='reflectivity over that of the reference')
        row[0].legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(out, dpi=90)


if __name__ == '__main__':
    if len(sys.argv) < 3 or not all('=' in argument for argument in sys.argv[2:]):
        sys.exit('Usage: plot_histograms.py OUT.png TITLE=FILE.csv ...')
    main(sys.argv[1], [argument.split('=', 1) for argument in sys.argv[2:]])
