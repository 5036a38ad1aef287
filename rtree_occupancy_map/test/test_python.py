#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
#
# The Python module of the map, and the example that draws a slice.
import copy
import math
import pathlib
import pickle
import subprocess
import sys
import tempfile
import unittest

import numpy
import rosunit

from rtree_occupancy_map import core

EXAMPLES = pathlib.Path(__file__).resolve().parents[1] / 'examples'
LOW, HIGH = numpy.array([0.05, 0.05, 0.05]), numpy.array([6.05, 4.05, 3.05])  # of a room, m: walls are amid voxels
MIDDLE = (LOW + HIGH) / 2


def directions(step=0.03):
    elevations, azimuths = numpy.meshgrid(numpy.arange(-1.5, 1.5, step), numpy.arange(0.0, 2 * math.pi, step))
    rows = numpy.stack([numpy.cos(elevations) * numpy.cos(azimuths), numpy.cos(elevations) * numpy.sin(azimuths),
                        numpy.sin(elevations)], axis=-1)
    return rows.reshape(-1, 3)


def walls(rays):
    """Where rays from the middle of the room meet its walls."""
    with numpy.errstate(divide='ignore'):
        return MIDDLE + (0.5 * (HIGH - LOW) / abs(rays)).min(axis=1, keepdims=True) * rays


def map_of_a_room(**options):
    room = core.OccupancyMap(resolution=0.1, **options)
    for _ in range(5):
        room.insert_scan(MIDDLE, walls(directions()))
    return room


class PythonTest(unittest.TestCase):

    @classmethod
    def setUpClass(cls):
        cls.room = map_of_a_room()
        cls.folder = tempfile.TemporaryDirectory()

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def path(self, name):
        return str(pathlib.Path(self.folder.name) / name)

    def test_options(self):
        options = core.OccupancyMap(**{'resolution': 0.25, 'sensor_model/max_range': 30.0, 'dynamic': False, 'tree/split': 'rstar'}).options
        self.assertEqual((options['resolution'], options['sensor_model/max_range'], options['dynamic'], options['tree/split']),
                         (0.25, 30.0, False, 'rstar'))
        for wrong, said in (({'resolution': -1.0}, 'resolution'), ({'resolutoin': 0.1}, 'resolutoin'), ({'resolution': 'fine'}, 'fine'),
                            ({'resolution': None}, 'resolution')):
            with self.assertRaisesRegex(ValueError, said):
                core.OccupancyMap(**wrong)

    def test_insertion_reports(self):
        room = core.OccupancyMap(**{'resolution': 0.1, 'sensor_model/max_range': 10.0, 'sensor_model/min_range': 0.5})
        hits = numpy.array([[1.0, 0, 0], [2, 0, 0], [numpy.nan, 0, 0], [0.1, 0, 0], [50, 0, 0], [0, 1e9, 0]])
        report = room.insert_scan([0.05, 0.05, 0.05], hits, misses=[[0.0, 0.0, 5.0]])
        self.assertEqual([report[key] for key in ('hits', 'non_finite', 'too_near', 'beyond_range')], [2, 1, 1, 2])
        self.assertGreater(report['changed_blocks'], 1)
        self.assertEqual(room.state_at([0.05, 0.05, 3.0]), core.FREE)
        self.assertEqual(len(room.occupied_cells()), 2)

    def test_states_and_log_odds(self):
        points = walls(directions(0.3))
        inside, outside = 0.5 * (points + MIDDLE), MIDDLE + 2.0 * (points - MIDDLE)
        states = self.room.state_at(numpy.concatenate([points, inside, outside]))
        self.assertEqual((states.dtype, states.shape), (numpy.int8, (3 * len(points),)))
        expected = numpy.repeat([core.OCCUPIED, core.FREE, core.UNKNOWN], len(points))
        self.assertGreater((states == expected).mean(), 0.99)  # rays graze other voxels in corners
        log_odds = self.room.log_odds_at(numpy.stack([MIDDLE + 0.3, MIDDLE + 100]))
        self.assertEqual((log_odds.dtype, log_odds.shape), (numpy.float32, (2,)))
        self.assertAlmostEqual(core.probability(log_odds)[0], 0.12, places=5)
        self.assertTrue(numpy.isnan(log_odds[1]))
        self.assertIsInstance(self.room.state_at(MIDDLE), int)
        self.assertIsInstance(self.room.log_odds_at(MIDDLE), float)

    def test_cells(self):
        cell = self.room.cell_at(MIDDLE)
        self.assertTrue((cell['min'] <= MIDDLE).all() and (MIDDLE < cell['max']).all())
        self.assertEqual(cell['occupied'], 0)
        self.assertIsNone(self.room.cell_at([100.0, 0.0, 0.0]))
        occupied, every = self.room.occupied_cells(), self.room.cells_in_box([-numpy.inf] * 3, [numpy.inf] * 3)
        statistics = self.room.statistics()
        self.assertEqual(len(every), statistics['cells'])
        self.assertEqual(len(self.room), statistics['cells'])
        self.assertEqual(len(occupied), statistics['occupied_cells'])
        self.assertEqual(every['occupied'].sum(), len(occupied))
        self.assertTrue((occupied['log_odds'] > 0).all())
        self.assertTrue(numpy.isnan(occupied['reflectivity']).all())
        self.assertAlmostEqual((occupied['max'] - occupied['min']).prod(axis=1).sum(), statistics['occupied_volume'])
        low, high = self.room.bounds
        numpy.testing.assert_allclose(low, every['min'].min(axis=0))
        numpy.testing.assert_allclose(high, every['max'].max(axis=0))
        in_box = self.room.cells_in_box([2, 1, 1], [4, 3, 3.2], occupied_only=True)
        self.assertTrue((in_box['min'][:, 2] > 2.8).all())  # the ceiling's
        self.assertGreater(len(in_box), 0)
        self.assertIsNone(core.OccupancyMap().bounds)

    def test_rays(self):
        rays = directions(0.1)
        hits = self.room.cast_rays(MIDDLE, rays, max_range=20.0)
        self.assertEqual(hits.shape, (len(rays),))
        self.assertGreater((hits['result'] == core.RAY_OCCUPIED).mean(), 0.99)
        expected = numpy.linalg.norm(walls(rays) - MIDDLE, axis=1)
        self.assertGreater((abs(hits['distance'] - expected) < 0.25).mean(), 0.95)
        numpy.testing.assert_allclose(numpy.linalg.norm(hits['point'] - MIDDLE, axis=1), hits['distance'])
        # From a place of its own each, and beyond what is known.
        starts = numpy.array([MIDDLE, [100.0, 0.0, 0.0]])
        each = self.room.cast_rays(starts, [[1.0, 0, 0], [1.0, 0, 0]], 50.0, ignore_unknown=False)
        self.assertEqual(each['result'].tolist(), [core.RAY_OCCUPIED, core.RAY_UNKNOWN])
        self.assertEqual(self.room.cast_rays([100.0, 0, 0], [[1.0, 0, 0]])['result'].tolist(), [core.RAY_NOTHING])
        self.assertTrue(numpy.isnan(each['log_odds'][1]))

    def test_nearest(self):
        nearest = self.room.nearest_occupied([0.3, 2.0, 1.5], k=20)
        self.assertEqual(len(nearest), 20)
        outside = numpy.maximum(0, numpy.maximum(nearest['min'] - [0.3, 2.0, 1.5], [0.3, 2.0, 1.5] - nearest['max']))
        distances = numpy.linalg.norm(outside, axis=1)
        self.assertTrue((numpy.diff(distances) >= -1e-9).all())
        self.assertLess(distances[0], 0.4)

    def test_reflectivity(self):
        room = core.OccupancyMap(resolution=0.1, reflectivity=True)
        room.insert_scan([0.05] * 3, [[1.05, 0.05, 0.05], [0.05, 1.05, 0.05]], reflectivity=[0.25, 0.75])
        cells = room.occupied_cells()
        numpy.testing.assert_allclose(sorted(cells['reflectivity']), [0.25, 0.75])
        self.assertEqual(cells['hits'].tolist(), [1, 1])

    def test_colors(self):
        room = core.OccupancyMap(resolution=0.1, color=True)
        hits = walls(directions(0.1))
        colors = numpy.clip(255 * (hits - LOW) / (HIGH - LOW), 0, 255).astype(numpy.uint8)
        for _ in range(5):
            room.insert_scan(MIDDLE, hits, colors=colors)
        seen = room.colors_at(hits)
        self.assertEqual((seen.dtype, seen.shape), (numpy.uint8, (len(hits), 4)))
        self.assertGreater((abs(seen[:, :3].astype(int) - colors).max(axis=1) < 20).mean(), 0.9)
        self.assertTrue((seen[:, 3] == 255).mean() > 0.99)
        self.assertEqual(room.colors_at(MIDDLE).tolist(), [0, 0, 0, 0])
        cells = room.occupied_cells()
        self.assertEqual(cells['color'].shape, (len(cells), 4))
        self.assertTrue((cells['color'][:, 3] == 255).all())
        for name in ('colors.map', 'colors.ot'):
            room.save(self.path(name))
            again = core.OccupancyMap.load(self.path(name))
            self.assertTrue(again.options['color'])
            self.assertGreater((abs(again.colors_at(hits).astype(int) - seen) <= 1).mean(), 0.9)
        with self.assertRaisesRegex(ValueError, 'rolling window'):
            room.keep_in(self.path('colors.db'))
        with self.assertRaisesRegex(ValueError, 'expected is'):
            room.insert_scan(MIDDLE, hits, colors=colors[:, 0])
        self.assertTrue((self.room.occupied_cells()['color'] == 0).all())

    def test_a_sensor_that_moves(self):
        hits, misses = numpy.array([[3.05, 0.05, 0.05], [3.05, 2.05, 0.05]]), numpy.array([[3.05, 4.05, 0.05]])
        street = core.OccupancyMap(resolution=0.1)
        street.insert_scan([0.05] * 3, hits, misses, hit_origins=hits - [2, 0, 0], miss_origins=misses - [2, 0, 0])
        between = numpy.concatenate([hits, misses]) - [1, 0, 0]
        self.assertEqual(street.state_at(between).tolist(), [core.FREE] * 3)
        self.assertEqual(street.state_at(between - [1.5, 0, 0]).tolist(), [core.UNKNOWN] * 3)
        for wrong in ({'hit_origins': hits[:1]}, {'miss_origins': hits}):
            with self.assertRaisesRegex(ValueError, 'origins'):
                street.insert_scan([0.05] * 3, hits, misses, **wrong)

    def test_times_let_obstacles_decay(self):
        room = core.OccupancyMap(resolution=0.1, decay_time=10.0)
        for time in range(10):
            room.insert_scan([0.05] * 3, [[2.05, 0.05, 0.05]], time=time)
        self.assertEqual(room.state_at([2.05, 0.05, 0.05]), core.OCCUPIED)
        room.insert_scan([0.05] * 3, [[0.05, 2.05, 0.05]], time=40.0)
        self.assertEqual(room.state_at([[2.05, 0.05, 0.05], [0.05, 2.05, 0.05], [1.05, 0.05, 0.05]]).tolist(),
                         [core.UNKNOWN, core.OCCUPIED, core.FREE])

    def test_range(self):
        room = core.OccupancyMap(resolution=0.1)
        room.set_range(0.5, 3.0)
        self.assertEqual((room.options['sensor_model/min_range'], room.options['sensor_model/max_range']), (0.5, 3.0))
        report = room.insert_scan([0.05] * 3, [[5.05, 0.05, 0.05], [0.25, 0.05, 0.05], [0.05, 2.05, 0.05]])
        self.assertEqual((report['hits'], report['beyond_range'], report['too_near']), (1, 1, 1))
        with self.assertRaisesRegex(ValueError, 'max_range'):
            room.set_range(1.0, 0.5)

    def test_merging(self):
        points = numpy.random.RandomState(3).uniform(LOW - 0.5, HIGH + 3.0, (2000, 3))
        shift = numpy.eye(4)
        shift[:3, 3] = [0.0, 0.0, 3.0]
        upstairs = self.room.transformed(shift)
        numpy.testing.assert_array_equal(upstairs.log_odds_at(points), self.room.log_odds_at(points - [0, 0, 3.0]))
        house = self.room.merged(upstairs)
        one, other = self.room.log_odds_at(points), upstairs.log_odds_at(points)
        expected = numpy.where(numpy.isnan(one), other, numpy.where(numpy.isnan(other), one, one + other))
        limits = [math.log(p / (1 - p)) for p in (0.12, 0.97)]
        numpy.testing.assert_allclose(house.log_odds_at(points), numpy.clip(expected, *limits), atol=1e-5)
        coarse = house.transformed(numpy.eye(4), resolution=0.4)
        self.assertEqual(coarse.resolution, 0.4)
        self.assertLess(len(coarse), len(house))
        occupied = house.occupied_cells()
        self.assertTrue((coarse.state_at(0.5 * (occupied['min'] + occupied['max'])) == core.OCCUPIED).all())
        with self.assertRaisesRegex(ValueError, 'resolution'):
            house.merged(coarse)
        for wrong in (numpy.eye(3), 2 * numpy.eye(4), numpy.diag([1.0, 1.0, -1.0, 1.0]), numpy.full((4, 4), numpy.nan)):
            with self.assertRaisesRegex(ValueError, 'transform'):
                house.transformed(wrong)
        with self.assertRaisesRegex(ValueError, 'resolutoin'):
            house.transformed(numpy.eye(4), resolutoin=0.4)

    def test_copies(self):
        points = numpy.random.RandomState(4).uniform(LOW - 0.5, HIGH + 0.5, (2000, 3))
        for again in (core.OccupancyMap.from_bytes(self.room.to_bytes()), pickle.loads(pickle.dumps(self.room)),
                      copy.copy(self.room), copy.deepcopy(self.room)):
            numpy.testing.assert_array_equal(again.log_odds_at(points), self.room.log_odds_at(points))
            again.clear()
        self.assertGreater(len(self.room), 0)
        with self.assertRaisesRegex(RuntimeError, 'checksum'):
            core.OccupancyMap.from_bytes(self.room.to_bytes()[:-1])

    def test_clearing(self):
        room = map_of_a_room()
        self.assertGreater(room.clear_box(LOW - 1, HIGH + 1), 0)
        self.assertEqual(len(room.occupied_cells()), 0)
        self.assertGreater(len(room), 0)
        room.clear()
        self.assertEqual(len(room), 0)

    def test_files(self):
        for name in ('room.map', 'room.ot', 'room.db'):
            self.room.save(self.path(name))
            again = core.OccupancyMap.load(self.path(name))
            points = numpy.random.RandomState(1).uniform(LOW - 0.5, HIGH + 0.5, (2000, 3))
            numpy.testing.assert_array_equal(self.room.log_odds_at(points), again.log_odds_at(points))
        self.room.save(self.path('room.pcd'))
        self.assertGreater(pathlib.Path(self.path('room.pcd')).stat().st_size, 12 * len(self.room.occupied_cells()))
        with self.assertRaisesRegex(RuntimeError, 'nowhere'):
            core.OccupancyMap.load('/nowhere/room.map')

    def test_rolling_window(self):
        room = map_of_a_room()
        room.keep_in(self.path('window.db'), distance=0.0, memory=0.0)
        room.insert_scan(MIDDLE, walls(directions()))
        room.insert_scan(MIDDLE + 100, MIDDLE + 100 + directions())
        room.flush()
        again = core.OccupancyMap.open(self.path('window.db'))
        points = numpy.random.RandomState(2).uniform(LOW - 0.5, HIGH + 0.5, (2000, 3))
        numpy.testing.assert_array_equal(room.log_odds_at(points), again.log_odds_at(points))
        self.assertEqual(len(room), len(again))
        self.assertGreater(len(room), len(self.room))

    def test_shapes_that_will_not_do(self):
        for call in (lambda: self.room.state_at([1.0, 2.0]), lambda: self.room.cell_at(numpy.zeros((4, 3))),
                     lambda: self.room.cast_rays(numpy.zeros((2, 3)), numpy.ones((3, 3))),
                     lambda: self.room.insert_scan(MIDDLE, numpy.zeros((5, 2))),
                     lambda: self.room.insert_scan(MIDDLE, numpy.zeros((5, 3)), reflectivity=[0.1])):
            with self.assertRaisesRegex(ValueError, r'expected is|reflectivities'):
                call()
        for call in (lambda: self.room.cast_rays(MIDDLE, [[0.0, 0.0, 0.0]]), lambda: self.room.insert_scan([numpy.nan] * 3, [])):
            self.assertRaises(ValueError, call)

    def test_docstrings_say_shapes_and_units(self):
        for name, words in (('cast_rays', ['(N, 3)', 'm', 'RAY_UNKNOWN']), ('insert_scan', ['(N, 3)', 'dict']), ('state_at', ['(N, 3)', 'int8'])):
            for word in words:
                self.assertIn(word, getattr(core.OccupancyMap, name).__doc__)
        self.assertIn('metres', core.__doc__)

    def test_slice(self):
        try:
            from matplotlib import image
        except ImportError:
            self.skipTest('python3-matplotlib is not installed')
        self.room.save(self.path('slice.map'))
        command = [sys.executable, str(EXAMPLES / 'plot_slice.py'), self.path('slice.map'), self.path('slice.png'), '-z', '1.5']
        subprocess.run(command, check=True)
        pixels = image.imread(self.path('slice.png'))[..., :3]
        for color in ((0xbb / 255,) * 3, (0.0, 0x72 / 255, 0xb2 / 255)):
            self.assertGreater((abs(pixels - color).max(axis=-1) < 0.01).mean(), 0.001)
        failed = subprocess.run(command[:2] + ['/nowhere/a.map', self.path('b.png')], stderr=subprocess.PIPE, universal_newlines=True)
        self.assertEqual(failed.returncode, 1)
        self.assertIn('/nowhere/a.map', failed.stderr)
        self.assertNotIn('Traceback', failed.stderr)


if __name__ == '__main__':
    rosunit.unitrun('rtree_occupancy_map', 'python', PythonTest)
