#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Plots what compare_octomap measured as the thesis's Fig. 2.9 (beam model) and 2.10 (beam-end point model)."""
import json
import pathlib
import sys

import matplotlib
matplotlib.use('Agg')
from matplotlib import pyplot  # noqa: E402

FIGURES = {'beam': ('fig_2_9.png', 'Beam-based model (Fig. 2.9)'),
           'endpoint': ('fig_2_10.png', 'Beam-end point model (Fig. 2.10)')}
PANELS = [('inner_nodes', 'inner nodes', 1.0), ('cells', 'cells', 1.0),
          ('insertion_ns_per_point', 'insertion per point (ns)', 1.0),
          ('occupied_access_s', 'access of the occupied cells (ms)', 1e3)]


def curves(runs, key):
    """Name -> values over the runs, which are sorted by resolution."""
    named = {'OctoMap, pruned': [r['octomap'][key] for r in runs]}
    if key in ('inner_nodes', 'cells'):
        named['OctoMap, without compression'] = [r['octomap_unpruned'][key] for r in runs]
    if key == 'cells':
        named['full 3D grid'] = [r['full_grid_voxels'] for r in runs]
    for i, first in enumerate(runs[0]['rtree_occupancy_maps']):
        # The node size doesn't change the number of cells.
        if key == 'cells' and first['max_entries'] != runs[0]['rtree_occupancy_maps'][0]['max_entries']:
            continue
        name = 'R-tree, %s' % first['fusion'] + ('' if key == 'cells' else ', M %d' % first['max_entries'])
        named[name] = [r['rtree_occupancy_maps'][i]['figures'][key] for r in runs]
    return named


def table(out, runs):
    for key, label, scale in PANELS:
        out.write('\n%s\n\n| |' % label)
        for run in runs:
            out.write(' %g m |' % run['resolution'])
        out.write('\n|---|%s\n' % ('---:|' * len(runs)))
        for name, values in curves(runs, key).items():
            out.write('| %s |' % name)
            for value in values:
                out.write((' {:,.2f} |' if key == 'occupied_access_s' else ' {:,.0f} |').format(scale * value))
            out.write('\n')


def plot(path, title, runs):
    figure, axes = pyplot.subplots(2, 2, figsize=(12, 9))
    resolutions = [r['resolution'] for r in runs]
    for axis, (key, label, scale) in zip(axes.flat, PANELS):
        for name, values in curves(runs, key).items():
            octomap = not name.startswith('R-tree')
            axis.semilogy(resolutions, [scale * v for v in values], '--' if octomap else '-',
                          marker='s' if octomap else '^' if 'thesis' in name else 'o', markersize=4, label=name)
        axis.set_xlabel('resolution (m)')
        axis.set_ylabel(label)
        axis.grid(True, which='both', alpha=0.3)
        axis.legend(fontsize=6)
    figure.suptitle('%s, %d scans, %.1f million points' % (title, runs[0]['scans'], 1e-6 * runs[0]['points']))
    figure.tight_layout()
    figure.savefig(path, dpi=110)


def main():
    folder = pathlib.Path(sys.argv[1])
    for model, (picture, title) in FIGURES.items():
        runs = sorted((json.loads(f.read_text()) for f in folder.glob(model + '-*.json')), key=lambda r: r['resolution'])
        if not runs:
            continue
        plot(folder / picture, title, runs)
        tables = folder / picture.replace('.png', '.md')
        with tables.open('w') as out:
            out.write('# %s\n\n%d scans, %d points\n' % (title, runs[0]['scans'], runs[0]['points']))
            table(out, runs)
        print('%s, %s' % (folder / picture, tables))


if __name__ == '__main__':
    main()
