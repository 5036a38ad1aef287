#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Draws what loop_closure_images has written to a folder: the similarities of the images, precision over recall (thesis,
Fig. 4.17), and the trajectory with its loops (Fig. 4.18), as PNG pictures beside the CSV files of the same names."""
import argparse
import csv
import pathlib
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

RIGHT, WRONG = '#009e73', '#d55e00'


def fail(text):
    sys.exit('plot_loops.py: ' + text)


def read(path):
    """Column -> its values; numbers where there are some, NaN where a field is empty."""
    with open(str(path)) as file:
        rows = list(csv.reader(file))
    columns = {}
    for name, texts in zip(rows[0], zip(*rows[1:]) if len(rows) > 1 else [()] * len(rows[0])):
        columns[name] = list(texts) if name == 'curve' else numpy.array([float(text or 'nan') for text in texts])
    return columns


def loops_by_outcome(loops):
    """[(label, colour, which of the loops)] of what there is."""
    correct = loops['correct']
    kinds = (('accepted loops', RIGHT, numpy.isnan(correct)), ('accepted loops that are right', RIGHT, correct == 1),
             ('accepted loops that are wrong', WRONG, correct == 0))
    return [('%s: %d' % (label, which.sum()), color, which) for label, color, which in kinds if which.any()]


def draw_similarities(figure, similarity, loops):
    """Above the diagonal the similarities, below it the loops, with their axes swapped."""
    queries = numpy.unique(similarity['query'])
    step = queries[1] - queries[0] if len(queries) > 1 else 1
    values = numpy.full((len(queries), len(queries)), numpy.nan)
    values[(similarity['query'] / step).astype(int), (similarity['match'] / step).astype(int)] = similarity['similarity']
    end = step * len(queries)
    axes = figure.add_subplot(111)
    # Consecutive images are much more alike than others.
    image = axes.imshow(values, origin='lower', extent=(0, end, 0, end), cmap='viridis', interpolation='nearest',
                        norm=colors.PowerNorm(0.5, vmin=0.0, vmax=max(1e-9, numpy.nanmax(values))))
    for label, color, which in loops_by_outcome(loops):
        axes.plot(loops['query'][which], loops['match'][which], '.', color=color, markersize=5, label=label)
    axes.set(xlabel='image', ylabel='image', xlim=(0, end), ylim=(0, end), title='Similarity of images (above the diagonal) and loops (below)')
    if len(loops['query']):
        axes.legend(loc='upper center', bbox_to_anchor=(0.5, -0.08), ncol=2, frameon=False)
    figure.colorbar(image, label='similarity by words in common')


def walks_of(sequences, positions):
    """The number of each image's walk: a folder is one, and a step of more than 10 mean ones begins another."""
    steps = numpy.linalg.norm(numpy.diff(positions, axis=1), axis=0)
    begins = (numpy.diff(sequences) != 0) | (steps > 10.0 * steps.sum() / max(1, len(steps)))
    return numpy.concatenate([[0], numpy.cumsum(begins)])


def draw_trajectory(figure, trajectory, loops):
    """From above, and over the number of the image, as what is gone twice lies on itself."""
    names = numpy.array(['x', 'y', 'z'])
    positions = numpy.array([trajectory[name] for name in names])
    walks = walks_of(trajectory['sequence'], positions)
    extents = positions.max(axis=1) - positions.min(axis=1)
    along, across = numpy.argsort(-extents, kind='stable')[:2]
    is_long = extents[along] > 5.0 * extents[across]
    from_above, in_order = figure.subplots(*((2, 1) if is_long else (1, 2)))
    for axes, ordinate in ((from_above, positions[across]), (in_order, trajectory['image'])):
        for i in range(walks[-1] + 1):
            of = walks == i
            axes.plot(positions[along][of], ordinate[of], '.-', color=('black', '0.6')[i % 2], markersize=3, linewidth=1,
                      label='images %d to %d' % (trajectory['image'][of][0], trajectory['image'][of][-1]))
        for label, color, which in loops_by_outcome(loops):
            ends = [numpy.array([values[loops[key][which].astype(int)] for key in ('match', 'query')])
                    for values in (positions[along], ordinate)]
            axes.plot(*ends, color=color, linewidth=0.8, zorder=1)[0].set_label(label)
        axes.set_xlabel(names[along] + ' (m)')
    from_above.set(ylabel=names[across] + ' (m)', title='From above' + (', %s stretched' % names[across] if is_long else ''))
    if not is_long:
        from_above.set_aspect('equal', adjustable='datalim')
    in_order.set(ylabel='image', title='In the order of the images')
    in_order.legend(loc='best', fontsize=9)
    figure.suptitle('Trajectory of the camera and its loops')


def draw_precision_recall(figure, curves):
    axes = figure.add_subplot(111)
    names = list(dict.fromkeys(name for name in curves['curve'] if name != 'accepted'))
    for i, name in enumerate(names):
        of = numpy.array([curve == name for curve in curves['curve']])
        recall, precision = 100.0 * curves['recall'][of], 100.0 * curves['precision'][of]
        best = recall[precision == 100.0].max() if (precision == 100.0).any() else 0.0
        # Where curves lie on each other, the wider ones show.
        axes.plot(recall, precision, color=pyplot.get_cmap('viridis')(0.9 * i / max(1, len(names) - 1)),
                  linewidth=1.5 + 1.5 * (len(names) - 1 - i), label='%s: recall %.1f %% at full precision' % (name, best))
    recall, precision = 100.0 * curves['recall'][-1], 100.0 * curves['precision'][-1]
    axes.plot(recall, precision, 'o', color=WRONG, markersize=8, clip_on=False, zorder=3,
              label='accepted loops: recall %.1f %%, precision %.1f %%' % (recall, precision))
    least = 100.0 * numpy.nanmin(curves['precision'])
    axes.set(xlabel='recall (%)', ylabel='precision (%)', xlim=(0, 100), ylim=(max(0, least - 20), 101),
             title='Precision and recall over all thresholds')
    axes.grid(True, alpha=0.3)
    axes.legend(loc='lower left')


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('folder', type=pathlib.Path, help='the --out of loop_closure_images')
    folder = parser.parse_args().folder
    if missing:
        fail('%s: install python3-matplotlib' % missing)
    if not (folder / 'loops.csv').is_file():
        fail('%s has no loops.csv: is it what loop_closure_images --out has written?' % folder)
    loops = read(folder / 'loops.csv')
    for name, draw, size, more in (('similarity', draw_similarities, (8.5, 7), (loops,)),
                                   ('trajectory', draw_trajectory, (11, 7), (loops,)),
                                   ('precision_recall', draw_precision_recall, (8, 6), ())):
        data = folder / (name + '.csv')
        if not data.is_file():
            continue
        figure = pyplot.figure(figsize=size)
        draw(figure, read(data), *more)
        figure.tight_layout(rect=(0, 0, 1, 0.98))
        figure.savefig(str(folder / (name + '.png')), dpi=90)
        pyplot.close(figure)


if __name__ == '__main__':
    main()
