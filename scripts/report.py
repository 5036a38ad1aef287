#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Puts what scripts/demo has written to a folder into one page, FOLDER/index.html, that opens from the disk and needs
nothing else: pictures, tables, and the 3D map to turn and zoom."""
import argparse
import base64
import csv
import html
import json
import pathlib
import string
import sys

# Title, what is seen, pictures and CSV tables (files of the folder, each with its caption). What isn't there is left out.
SECTIONS = (
    ('The whole', 'A simulated robot drives once around a floor whose rooms and corridors are alike but for what their walls '
     'reflect, and on along the corridor where it began. An emulated Hokuyo speaks SCIP over TCP to its driver; intensities '
     'become reflectivities; SLAM makes a map and finds loops; a camera finds loops, too, and a lidar recognises places; the pose graph takes all of them, '
     'corrects the trajectory, and has the maps made anew.', (
         ('building/before.png', 'The map of the same drive without loops'),
         ('building/after.png', 'The corrected map'),
         ('building/graph.png', 'The graph: true and estimated way, and the loops that were accepted'),
         ('building/rviz.png', 'RViz at the end of the drive'),
         ('building/accuracy.csv', 'Errors of the way, laid over the true one. The scanner\'s clock is known to about 20 ms, in which it moves 2 cm'))),
    ('Drivers', 'An emulated Hokuyo in a small room, through its driver.', (('scan.png', 'The scan in RViz'),)),
    ('Intensity calibration', 'Intensities of a white wall over range and angle of incidence, which become a table.', (
        ('calibration/calibration.png', 'The table'),)),
    ('SLAM', 'A room seen by a scanner with a narrow field of view.', (
        ('slam_costs.png', 'What each cost makes of it; black: the true walls and way'),
        ('slam.png', 'Live: reflectivities, map and path in RViz'))),
    ('3D map', 'Streets as cuboids that fuse as the map settles.', (
        ('map.png', 'The map in RViz'),)),
    ('Loop closure', 'A camera goes along a street twice, the second time darker and beside its first way.', (
        ('loops/trajectory.png', 'The way, and where it was seen again'),
        ('loops/precision_recall.png', 'Precision over recall'),
        ('loops/similarity.png', 'Similarities of the images, and the loops'))),
)
MAP = 'building/cloud.map'
MOST_CUBOIDS = 300000


def figure(path, caption):
    data = base64.b64encode(path.read_bytes()).decode()
    return '<figure><img src="data:image/png;base64,%s" alt="%s"><figcaption>%s</figcaption></figure>' % (
        data, html.escape(caption), html.escape(caption))


def table(path, caption):
    with open(str(path)) as file:
        rows = [''.join('<%s>%s</%s>' % (tag, html.escape(field), tag) for field in row)
                for tag, row in zip(['th'] + ['td'] * 10000, csv.reader(file))]
    return '<figure><table>%s</table><figcaption>%s</figcaption></figure>' % (
        ''.join('<tr>%s</tr>' % row for row in rows), html.escape(caption))


def cuboids(path):
    """The occupied cells of an R-tree map, as viewer.js takes them."""
    import numpy
    from rtree_occupancy_map import core
    room = core.OccupancyMap.load(str(path))
    cells = room.occupied_cells()
    low = numpy.round(cells['min'] / room.resolution)
    size = numpy.round((cells['max'] - cells['min']) / room.resolution)
    middle = numpy.median(low, axis=0) if len(low) else 0
    boxes = numpy.clip(numpy.hstack([low - middle, size]), -32768, 32767).astype('<i2')[:MOST_CUBOIDS]
    heights = cells['min'][:, 2]
    least, most = numpy.percentile(heights, [1, 99]) if len(heights) else (0, 1)
    values = numpy.clip(255 * (heights - least) / max(most - least, 1e-9), 0, 255).astype('u1')[:MOST_CUBOIDS]
    encode = lambda array: base64.b64encode(array.tobytes()).decode()  # noqa: E731
    return {'boxes': encode(boxes), 'values': encode(values)}, len(cells), room.resolution


def map_section(folder, web):
    """The 3D map's section and scripts."""
    data, count, resolution = cuboids(folder / MAP)
    section = ('<h2>The 3D map</h2><p>Corrected, from the clouds of a lidar with 16 beams: %d cuboids of voxels of %g m, '
               'coloured by height. Turn with the left button, move with the right, zoom with the wheel.</p>'
               '<canvas id="map"></canvas><p><label>Cut at a height: <input id="height" type="range" min="1" max="100" value="80">'
               '</label></p>' % (count, resolution))
    scripts = [(web / name).read_text() for name in ('three.min.js', 'OrbitControls.js', 'viewer.js')]
    scripts.append('showMap(document.getElementById("map"), document.getElementById("height"), %s);' % json.dumps(data))
    return section, '\n'.join('<script>%s</script>' % script for script in scripts)


def write(folder, web):
    sections, pictures = [], 0
    for title, text, files in SECTIONS:
        shown = [(folder / name, caption) for name, caption in files if (folder / name).is_file()]
        if not shown:
            continue
        figures = [table(*each) if each[0].suffix == '.csv' else figure(*each) for each in shown]
        pictures += len(figures)
        sections.append('<h2>%s</h2><p>%s</p><div class="pair">%s</div>' % (html.escape(title), html.escape(text),
                                                                            '\n'.join(figures)))
    scripts = ''
    if (folder / MAP).is_file():
        section, scripts = map_section(folder, web)
        sections.insert(1, section)
    if not sections:
        sys.exit('report.py: in %s is nothing that the demo writes' % folder)
    page = string.Template((web / 'page.html').read_text()).substitute(
        summary='%d pictures and tables. All is simulated; the commands are in scripts/demos.' % pictures,
        sections='\n'.join(sections), scripts=scripts)
    (folder / 'index.html').write_text(page)


def main():
    parser = argparse.ArgumentParser(prog='report.py', description=__doc__)
    parser.add_argument('folder', type=pathlib.Path, help='what the demo has written to')
    parser.add_argument('--web', type=pathlib.Path, default=pathlib.Path(__file__).resolve().parent / 'report',
                        help='folder of the page and its scripts')
    arguments = parser.parse_args()
    try:
        write(arguments.folder, arguments.web)
    except (OSError, RuntimeError, ValueError) as problem:
        sys.exit('report.py: %s' % problem)


if __name__ == '__main__':
    main()
