#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Draws a pose graph from above (a file of g2o), as a PNG picture: the way along its poses, and its loops. With --truth
(TUM's format), the true way, moved so that it fits; with --map, a map of map_server beneath."""
import argparse
import math
import pathlib
import sys

try:
    import matplotlib
    matplotlib.use('Agg')
    from matplotlib import collections, pyplot
    import numpy
except ImportError as error:
    missing = error  # said after --help
else:
    missing = None

WAY, LOOP, TRUTH = '#0072b2', '#009e73', '#444444'


def fail(text):
    sys.exit('plot_graph.py: ' + text)


def read_graph(path):
    """Poses {id: (x, y)}, and edges [(id, id)]."""
    poses, edges = {}, []
    for line in pathlib.Path(path).read_text().splitlines():
        fields = line.split()
        if fields and fields[0].startswith('VERTEX'):
            poses[int(fields[1])] = (float(fields[2]), float(fields[3]))
        elif fields and fields[0].startswith('EDGE'):
            edges.append((int(fields[1]), int(fields[2])))
    if not poses:
        fail('%s has no poses (VERTEX_SE2 or VERTEX_SE3:QUAT)' % path)
    return poses, edges


def read_tum(path):
    rows = [line.split() for line in pathlib.Path(path).read_text().splitlines() if line and line[0] != '#']
    return numpy.array([[float(row[0]), float(row[1]), float(row[2])] for row in rows])


def read_map(path):
    """The picture of a map, and where it is: left, right, bottom, top (m)."""
    import yaml
    path = pathlib.Path(path)
    values = yaml.safe_load(path.read_text())
    with open(str(path.parent / values['image']), 'rb') as file:
        if file.readline().strip() != b'P5':
            fail('%s is no binary PGM' % values['image'])
        fields = []
        while len(fields) < 3:
            fields += file.readline().split(b'#')[0].split()
        width, height, most = (int(field) for field in fields)
        image = numpy.frombuffer(file.read(width * height), 'u1').reshape(height, width) * (255.0 / most)
    x, y, scale = values['origin'][0], values['origin'][1], values['resolution']
    return image, (x, x + width * scale, y, y + height * scale)


def laid_over(points, stamps, truth):
    """The true way in the frame of the poses, by the least squares over a rotation and a translation (in the plane)."""
    at = numpy.stack([numpy.interp(stamps, truth[:, 0], truth[:, i]) for i in (1, 2)], axis=1)
    a, b = at - at.mean(axis=0), points - points.mean(axis=0)
    angle = math.atan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    turn = numpy.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    return (truth[:, 1:] - at.mean(axis=0)) @ turn + points.mean(axis=0)


def segments(axes, poses, pairs, label, **style):
    pairs = [(a, b) for a, b in pairs if a in poses and b in poses]
    if pairs:
        axes.add_collection(collections.LineCollection([(poses[a], poses[b]) for a, b in pairs],
                                                       label='%s: %d' % (label, len(pairs)), **style))


def draw(arguments):
    poses, edges = read_graph(arguments.graph)
    points = numpy.array(list(poses.values()))
    figure, axes = pyplot.subplots(figsize=(10, 7))
    if arguments.map:
        image, extent = read_map(arguments.map)
        axes.imshow(image, cmap='gray', vmin=0, vmax=255, extent=extent, interpolation='nearest')
    if arguments.truth:
        way = read_tum(arguments.trajectory)
        true_way = laid_over(way[:, 1:], way[:, 0] - arguments.shift, read_tum(arguments.truth))
        axes.plot(true_way[:, 0], true_way[:, 1], '--', color=TRUTH, linewidth=1, label='true way')
    successors = dict(zip(sorted(poses), sorted(poses)[1:]))
    segments(axes, poses, [e for e in edges if successors.get(min(e)) == max(e)], 'edges along the way', color=WAY,
             linewidth=1.5)
    segments(axes, poses, [e for e in edges if successors.get(min(e)) != max(e)], 'loops', color=LOOP, linewidth=0.7)
    axes.plot(points[:, 0], points[:, 1], '.', color=WAY, markersize=3, label='key poses: %d' % len(poses))
    margin = 0.03 * max(numpy.ptp(points[:, 0]), numpy.ptp(points[:, 1])) + 0.5
    if not arguments.map:
        axes.set(xlim=(points[:, 0].min() - margin, points[:, 0].max() + margin),
                 ylim=(points[:, 1].min() - margin, points[:, 1].max() + margin))
    axes.set(xlabel='x (m)', ylabel='y (m)', aspect='equal', title=arguments.title)
    axes.legend(loc='upper center', bbox_to_anchor=(0.5, -0.1), ncol=4, frameon=False)
    figure.savefig(str(arguments.picture), dpi=110, bbox_inches='tight')


def main():
    parser = argparse.ArgumentParser(prog='plot_graph.py', description=__doc__)
    parser.add_argument('graph', help='file of g2o, in the plane or in space')
    parser.add_argument('picture', help='PNG file to write')
    parser.add_argument('--title', default='Pose graph from above')
    parser.add_argument('--map', help='YAML file of a map, as map_saver writes it')
    parser.add_argument('--truth', help='true poses in TUM\'s format')
    parser.add_argument('--trajectory', help='the graph\'s poses in TUM\'s format, which have stamps; for --truth')
    parser.add_argument('--shift', type=float, default=0.0, help='s, from the stamps of the truth to those of the trajectory')
    arguments = parser.parse_args()
    if missing is not None:
        fail('%s: install python3-matplotlib' % missing)
    if arguments.truth and not arguments.trajectory:
        parser.error('--truth needs --trajectory')
    try:
        draw(arguments)
    except (OSError, ValueError, IndexError) as problem:
        fail(str(problem))


if __name__ == '__main__':
    main()
