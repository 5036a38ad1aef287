#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Draws what compare_octomap --json has measured, as scripts/bench calls it, as the thesis's Fig. 2.9 (beam model) and 2.10
(beam-end point model), with tables in Markdown beside the pictures."""
import argparse
import json
import pathlib
import sys

try:
    import matplotlib
    matplotlib.use('Agg')
    from matplotlib import pyplot
except ImportError as error:
    missing = error  # said after --help
else:
    missing = None

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
        name = 'R-tree, %s, ' % first['fusion'] + ('any M' if key == 'cells' else 'M %d' % first['max_entries'])
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


def style(name, names):
    """Colour, line and marker of a curve: its own, and that of the same map in each panel."""
    rest = {'OctoMap, pruned': ('black', '--', 's'), 'OctoMap, without compression': ('0.45', '--', 'D'),
            'full 3D grid': ('0.65', ':', 'v')}
    if name in rest:
        return rest[name]
    thesis = 'thesis' in name
    alike = [other for other in names if other.startswith('R-tree') and ('thesis' in other) == thesis]
    shade = 0.35 + 0.6 * (alike.index(name) + 1) / len(alike)
    return pyplot.get_cmap('Oranges' if thesis else 'Blues')(shade), '-', '^' if thesis else 'o'


def plot(path, title, runs):
    figure, axes = pyplot.subplots(2, 2, figsize=(13, 8.5))
    resolutions = [r['resolution'] for r in runs]
    handles = {}
    for axis, (key, label, scale) in zip(axes.flat, PANELS):
        named = curves(runs, key)
        for name, values in named.items():
            color, line, marker = style(name, list(named))
            handles[name], = axis.semilogy(resolutions, [scale * v for v in values], line, color=color, marker=marker,
                                           markersize=5)
        axis.set(xlabel='resolution (m)', ylabel=label, xticks=resolutions)
        axis.grid(True, which='major', alpha=0.4)
    figure.suptitle('%s: R-tree map and OctoMap, %d scans, %.1f million points' %
                    (title, runs[0]['scans'], 1e-6 * runs[0]['points']))
    figure.legend(handles.values(), handles.keys(), loc='center right')
    figure.tight_layout(rect=(0, 0, 0.79, 0.97))
    figure.savefig(str(path), dpi=90)
    pyplot.close(figure)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('folder', type=pathlib.Path, help='with MODEL-RESOLUTION.json, MODEL: beam or endpoint')
    folder = parser.parse_args().folder
    drawn = False
    for model, (picture, title) in FIGURES.items():
        runs = sorted((json.loads(f.read_text()) for f in folder.glob(model + '-*.json')), key=lambda r: r['resolution'])
        if not runs:
            continue
        drawn = True
        tables = folder / picture.replace('.png', '.md')
        with tables.open('w') as out:
            out.write('# %s\n\n%d scans, %d points\n' % (title, runs[0]['scans'], runs[0]['points']))
            table(out, runs)
        print(tables)
        if not missing:
            plot(folder / picture, title, runs)
            print(folder / picture)
    if not drawn:
        sys.exit('plot_bench.py: %s has no MODEL-RESOLUTION.json: is it out/bench, which scripts/bench has written?' % folder)
    if missing:
        sys.exit('plot_bench.py: tables alone, %s: install python3-matplotlib' % missing)


if __name__ == '__main__':
    main()
