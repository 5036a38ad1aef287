#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Draws a horizontal slice of a map (.map, .bt, .ot): what is occupied, free and unknown at a height, as a PNG picture."""
import argparse
import sys

try:
    import matplotlib
    matplotlib.use('Agg')
    from matplotlib import colors, pyplot
    import numpy
except ImportError as error:
    missing = error  # said after --help
else:
    missing = None

STATES = (('unknown', '#bbbbbb'), ('free', '#ffffff'), ('occupied', '#0072b2'))  # UNKNOWN, FREE, OCCUPIED
MOST_PIXELS = 4000  # along an edge


def draw(occupancy_map, z, path):
    low, high = occupancy_map.bounds
    step = max(occupancy_map.resolution, max(high[:2] - low[:2]) / MOST_PIXELS)
    x, y = (numpy.arange(low[i] + step / 2, high[i], step) for i in range(2))
    points = numpy.stack(numpy.meshgrid(x, y) + [numpy.full((len(y), len(x)), z)], axis=-1)
    states = occupancy_map.state_at(points.reshape(-1, 3)).reshape(len(y), len(x))

    figure, axes = pyplot.subplots(figsize=(9, 7))
    axes.imshow(states, origin='lower', extent=(x[0] - step / 2, x[-1] + step / 2, y[0] - step / 2, y[-1] + step / 2),
                cmap=colors.ListedColormap([color for _, color in STATES]), vmin=-0.5, vmax=2.5, interpolation='nearest')
    for name, color in STATES:
        axes.plot([], [], 's', color=color, markeredgecolor='#444444', label=name)
    axes.set(xlabel='x (m)', ylabel='y (m)', title='The map at z = %g m, voxels of %g m' % (z, occupancy_map.resolution))
    axes.legend(loc='upper center', bbox_to_anchor=(0.5, -0.1), ncol=3, frameon=False)
    figure.savefig(path, dpi=120, bbox_inches='tight')


def main():
    parser = argparse.ArgumentParser(prog='plot_slice.py', description=__doc__)
    parser.add_argument('map', help='file of the map')
    parser.add_argument('picture', help='PNG file to write')
    parser.add_argument('-z', type=float, default=1.0, help='height in the frame of the map, m (default: 1)')
    arguments = parser.parse_args()
    if missing is not None:
        sys.exit('plot_slice.py: %s: install python3-matplotlib' % missing)
    from rtree_occupancy_map import core
    try:
        occupancy_map = core.OccupancyMap.load(arguments.map)
        if len(occupancy_map) == 0:
            sys.exit('plot_slice.py: %s is an empty map' % arguments.map)
        draw(occupancy_map, arguments.z, arguments.picture)
    except (OSError, RuntimeError, ValueError) as error:
        sys.exit('plot_slice.py: %s' % error)


if __name__ == '__main__':
    main()
