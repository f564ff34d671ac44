"""Keeping the maps of a server: copies, the trash, checks, alignment, files, history, and where they are on the earth."""
import base64
import json
import math
import pathlib
import shutil
import sqlite3
import subprocess
import tempfile
import unittest

from cairn_cli import BINARY, cairn, must
from served_maps import Server

NPM = pathlib.Path(__file__).resolve().parents[1] / 'npm'
SIZE, FOCAL = (480, 360), 315
HELSINKI = (60.1699, 24.9384, 30.0)
# The length of a degree there, metres: to the north and to the east.
DEGREE_NORTH, DEGREE_EAST = 111415.2, 55513.6


def truth_of(visit):
    """Rows of t x y z qx qy qz qw."""
    return [[float(field) for field in line.split()] for line in (visit / 'groundtruth_cam0.txt').read_text().splitlines()
            if not line.startswith('#')]


def on_the_earth(pose):
    """Of a position in the world of the recording, whose x axis points to the east and whose y axis to the north."""
    return HELSINKI[0] + pose[2] / DEGREE_NORTH, HELSINKI[1] + pose[1] / DEGREE_EAST, HELSINKI[2] + pose[3]


class KeepMaps(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix='cairn-e2e-'))
        cls.visit, cls.made = cls.folder / 'visit', cls.folder / 'office.cairn'
        must('synth', 'office', '--seed', 4, '--duration', 5, '--image-size', *SIZE, '--focal', FOCAL, '--out', cls.visit)
        must('run', cls.visit, '--deterministic', '--map', cls.made)
        cls.truth = truth_of(cls.visit)
        cls.photos = sorted((cls.visit / 'mav0/cam0/data').glob('*.png'))

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    def setUp(self):
        self.maps = pathlib.Path(tempfile.mkdtemp(prefix='maps-', dir=self.folder))
        shutil.copy(self.made, self.maps / 'office.cairn')
        self.server = Server(self.maps)

    def tearDown(self):
        self.server.stop()

    def ask(self, *arguments):
        return cairn('--server', self.server.address, *arguments)

    def must_ask(self, *arguments):
        answer = self.ask(*arguments)
        self.assertEqual(answer.code, 0, f'{answer.out}{answer.err}')
        return answer.json

    def test_copies_checks_and_files(self):
        copy = self.must_ask('snapshot', 'office', 'before')
        self.assertEqual(copy['name'], 'before')
        digest = must('info', self.made, '--digest')['digest']
        self.assertEqual(must('info', self.maps / 'before.cairn', '--digest')['digest'], digest)
        self.assertEqual(self.ask('snapshot', 'office', 'before').json['fault'], 'exists')
        self.assertEqual(self.ask('snapshot', 'office', '../elsewhere').code, 1)
        self.assertTrue(self.must_ask('verify', 'office', '--deep')['good'])
        self.assertEqual(self.ask('verify', 'kitchen').code, 1)
        for name in ('whole.cairn', 'poses.txt', 'points.ply'):
            file, here = self.folder / f'served-{name}', self.folder / f'local-{name}'
            self.assertEqual(self.must_ask('export', 'office', file)['bytes'], file.stat().st_size)
            must('export', self.made, here)
            if name != 'whole.cairn':
                self.assertEqual(file.read_bytes(), here.read_bytes())
        self.assertEqual(must('info', self.folder / 'served-whole.cairn', '--digest')['digest'], digest)
        self.assertEqual(self.ask('export', 'office', self.folder / 'served-points.ply').code, 1, 'it exists')
        self.assertEqual(self.ask('export', 'office', self.folder / 'points.xyz').code, 2)
        # What the server does not make is made here, of the map as it has it.
        served = self.must_ask('export', 'office', self.folder / 'served-model', '--format', 'colmap-text')
        local = must('export', self.made, self.folder / 'local-model', '--format', 'colmap-text')
        self.assertEqual({**served, 'map': '', 'out': ''}, {**local, 'map': '', 'out': ''})
        for name in ('cameras.txt', 'images.txt', 'points3D.txt'):
            self.assertEqual(*((self.folder / model / name).read_bytes() for model in ('served-model', 'local-model')))
        self.assertEqual(self.must_ask('export', 'office', self.folder / 'served.json')['format'], 'json')
        damaged = self.maps / 'damaged.cairn'
        shutil.copy(self.made, damaged)
        with sqlite3.connect(damaged) as database:
            database.execute('UPDATE keyframe_features SET words = zeroblob(length(words))')
        database.close()
        self.assertEqual(self.ask('snapshot', 'damaged', 'damaged-copy').code, 3)
        self.assertEqual(self.ask('export', 'damaged', self.folder / 'damaged-copy.cairn').code, 3)
        self.assertEqual([path for folder in (self.maps, self.folder) for path in folder.glob('damaged-copy*')], [])
        damaged.unlink()
        again = self.folder / 'again.cairn'
        self.assertEqual(must('snapshot', self.made, again)['revision'], copy['revision'])
        self.assertEqual(cairn('snapshot', self.made, again).code, 1, 'it exists')

    def test_the_trash(self):
        deleted = self.must_ask('delete', 'office')['deleted']
        self.assertEqual(self.must_ask('ls')['maps'], [])
        self.assertEqual([m['deleted'] for m in self.must_ask('restore', '--list')['trash']], [deleted])
        self.assertEqual(self.must_ask('restore', deleted, '--as', 'office-old')['map'], 'office-old')
        self.assertEqual([m['name'] for m in self.must_ask('ls')['maps']], ['office-old'])
        self.assertEqual(self.ask('restore', deleted).json['fault'], 'not_found')
        # The same without a server.
        deleted = must('delete', self.maps / 'office-old.cairn')['deleted']
        self.assertEqual(must('restore', deleted, '--directory', self.maps)['map'], 'office-old')
        self.assertEqual(must('restore', '--list', '--directory', self.maps)['trash'], [])
        self.assertEqual(cairn('restore').code, 2)

    def test_alignment_and_history(self):
        truth = self.visit / 'groundtruth_cam0.txt'
        served = self.must_ask('align', 'office', '--groundtruth', truth)
        here = self.folder / 'aligned.cairn'
        shutil.copy(self.made, here)
        local = must('align', here, '--groundtruth', truth)
        for key in ('inliers', 'keyframes_used', 'rmse_m', 'scale', 'orientations', 'position_sigma_m'):
            self.assertEqual(served[key], local[key])
        self.assertIn('--overwrite', self.ask('align', 'office', '--groundtruth', truth).json['error'])
        log = self.must_ask('log', 'office', '--count', 1)
        self.assertEqual(log['changes'][0]['reason'], 'align component 1 to the world')
        self.assertEqual(log['revision'], served['revision'])
        self.assertEqual(self.ask('log', 'office', '--session', 9).code, 1)

    def test_where_it_is_on_the_earth(self):
        anchor = ' '.join(map(str, HELSINKI))
        self.assertIn('not aligned', self.ask('align', 'office', '--geo', anchor).json['error'])
        self.assertEqual(self.ask('align', 'office', '--geo', '91 0 0').code, 2)
        self.assertEqual(self.ask('align', 'office', '--geo', anchor, '--groundtruth', 'x').code, 2)
        self.must_ask('align', 'office', '--groundtruth', self.visit / 'groundtruth_cam0.txt')
        placed = self.must_ask('align', 'office', '--geo', anchor, '--heading', 90)
        self.assertEqual(placed['geo_anchor']['latitude_deg'], HELSINKI[0])
        self.assertAlmostEqual(placed['geo_anchor']['enu_from_world_xyzw'][3], 1.0)
        self.assertEqual(must('info', self.maps / 'office.cairn')['geo_anchor'], placed['geo_anchor'])
        self.assertEqual(self.must_ask('info', 'office')['geo_anchor'], placed['geo_anchor'])
        described = cairn('--server', self.server.address, 'info', 'office', json_output=False).out
        self.assertIn('60.16990000 24.93840000', described)
        self.assertIn("x axis points to 90.00 deg", described)
        self.assertIsNone(self.must_ask('align', 'office', '--geo', 'none')['geo_anchor'])

    def test_by_positions_of_keyframes(self):
        positions = self.folder / 'gnss.txt'
        rows = [(pose[0], *on_the_earth(pose)) for pose in self.truth]
        positions.write_text('# time latitude longitude height\n' + ''.join(f'{t:.9f} {a:.12f} {b:.12f} {h:.6f}\n' for t, a, b, h in rows))
        alone = self.folder / 'by_positions.cairn'
        shutil.copy(self.made, alone)
        found = must('align', alone, '--geo-positions', positions)
        self.assertGreater(found['keyframes_used'], 3)
        self.assertLess(found['rmse_m'], 0.02)
        # The world is east, north, up at the first position: keyframes are where they were.
        poses = self.folder / 'by_positions.txt'
        must('export', alone, poses)
        first = self.truth[0]
        true = {round(pose[0], 3): [a - b for a, b in zip(pose[1:4], first[1:4])] for pose in self.truth}
        for line in poses.read_text().splitlines():
            if line.startswith('#'):
                continue
            fields = [float(field) for field in line.split()]
            self.assertLess(math.dist(fields[1:4], true[round(fields[0], 3)]), 0.05)
        # Of a map that is aligned they find where its world is.
        self.must_ask('align', 'office', '--groundtruth', self.visit / 'groundtruth_cam0.txt')
        anchor = self.must_ask('align', 'office', '--geo-positions', positions)['geo_anchor']
        self.assertAlmostEqual((anchor['latitude_deg'] - HELSINKI[0]) * DEGREE_NORTH, 0, delta=0.05)
        self.assertAlmostEqual((anchor['longitude_deg'] - HELSINKI[1]) * DEGREE_EAST, 0, delta=0.05)
        self.assertAlmostEqual(anchor['height_m'], HELSINKI[2], delta=0.05)
        self.assertGreater(anchor['enu_from_world_xyzw'][3], math.cos(math.radians(0.5)))
        positions.write_text('# keyframe latitude longitude height\n1 60 25 0\n2 60 25 x\n')
        self.assertIn('gnss.txt:3', self.ask('align', 'office', '--geo-positions', positions).json['error'])

    def place(self):
        self.must_ask('align', 'office', '--groundtruth', self.visit / 'groundtruth_cam0.txt')
        self.must_ask('align', 'office', '--geo', ' '.join(map(str, HELSINKI)))

    def check_geopose(self, answer, photo):
        """The recording's own pose of that photo, on the earth."""
        true = self.truth[photo]
        latitude, longitude, height = on_the_earth(true)
        position, q = answer['geopose']['position'], answer['geopose']['quaternion']
        self.assertAlmostEqual((position['lat'] - latitude) * DEGREE_NORTH, 0, delta=0.05)
        self.assertAlmostEqual((position['lon'] - longitude) * DEGREE_EAST, 0, delta=0.05)
        self.assertAlmostEqual(position['h'], height, delta=0.05)
        # Where its x axis points: along the optical axis of the camera, which is z of its pose.
        forward = (1 - 2 * (q['y'] ** 2 + q['z'] ** 2), 2 * (q['x'] * q['y'] + q['w'] * q['z']), 2 * (q['x'] * q['z'] - q['w'] * q['y']))
        x, y, z, w = true[4:]
        optical = (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y))
        self.assertLess(math.dist(forward, optical), 0.02)
        self.assertLess(answer['accuracy']['position'], 0.5)

    def test_geopose_protocol(self):
        self.place()
        photo = 30
        camera = {'model': 'PINHOLE', 'modelParams': [FOCAL, FOCAL, SIZE[0] / 2, SIZE[1] / 2]}
        request = {'id': 'a', 'timestamp': 5, 'type': 'geopose', 'sensors': [],
                   'sensorReadings': {'cameraReadings': [{'imageFormat': 'JPG', 'size': SIZE, 'params': camera,
                                                          'imageBytes': base64.b64encode(self.photos[photo].read_bytes()).decode()}]}}
        # As curl asks: it takes anything.
        done = subprocess.run(['curl', '-sS', '-X', 'POST', f'{self.server.url}/geopose', '-d', '@-'], input=json.dumps(request),
                              capture_output=True, text=True, timeout=20) if shutil.which('curl') else None
        if done is None:
            self.skipTest('there is no curl')
        answer = json.loads(done.stdout)
        self.assertEqual((answer['id'], answer['timestamp'], answer['type']), ('a', 5, 'geopose'), done.stdout)
        self.check_geopose(answer, photo)
        self.assertEqual(self.server.get('/geopose')[0], 200)
        self.assertEqual(self.server.get('/geopose', b'{}', 'application/json')[0], 400)

    def test_geopose_with_the_client_of_the_open_ar_cloud(self):
        if not shutil.which('npm') or not shutil.which('node'):
            self.skipTest('there is no npm')
        client = self.folder / 'npm'
        shutil.copytree(NPM, client, ignore=shutil.ignore_patterns('node_modules'))
        try:
            installed = subprocess.run(['npm', 'ci', '--no-audit', '--no-fund'], cwd=client, capture_output=True, text=True, timeout=60)
        except subprocess.TimeoutExpired:
            self.skipTest('npm has no network')
        if installed.returncode != 0:
            self.skipTest(f'npm ci: {installed.stderr[-300:]}')

        def ask(photo, *prior):
            return subprocess.run(['node', '--import', './directory_imports.mjs', 'geopose_client.mjs', f'{self.server.url}/geopose', self.photos[photo],
                                   *map(str, SIZE), 'PINHOLE', f'{FOCAL},{FOCAL},{SIZE[0] / 2},{SIZE[1] / 2}', *map(str, prior)],
                                  cwd=client, capture_output=True, text=True, timeout=60)
        nowhere = ask(30)
        self.assertEqual(nowhere.returncode, 1)
        self.assertIn('Network response was not OK', nowhere.stderr)
        self.assertIn('no map here has a geographic anchor', nowhere.stderr)
        self.place()
        found = ask(30)
        self.assertEqual(found.returncode, 0, found.stderr)
        self.check_geopose(json.loads(found.stdout), 30)
        self.assertEqual(ask(40, HELSINKI[0] + 0.001, HELSINKI[1]).returncode, 0)
        self.assertIn('no map near', ask(40, -33.9, 151.2).stderr)

    def test_in_which_map(self):
        self.must_ask('snapshot', 'office', 'copy')
        camera = self.folder / 'camera.yaml'
        camera.write_text(f'model: pinhole\nresolution_px: {list(SIZE)}\nintrinsics_px: [{FOCAL}, {FOCAL}, 239.5, 179.5]\n')
        for which in (['--map', 'office,copy'], ['--all-maps']):
            answer = self.must_ask('localize', self.photos[20], '--camera', camera, *which)
            self.assertTrue(answer['localized'])
            self.assertIn(answer['in_map'], ('office', 'copy'), 'a copy is no rival')
        self.assertEqual(self.ask('localize', self.photos[20], '--camera', camera, '--map', 'cellar,kitchen').code, 1)

    def test_photos_of_a_camera_that_several_maps_have_need_no_calibration(self):
        self.must_ask('snapshot', 'office', 'copy')
        photo, files = self.photos[20], [self.maps / 'office.cairn', self.maps / 'copy.cairn']
        for which in (['--map', 'office,copy'], ['--map', 'office', '--map', 'copy'], ['--all-maps']):
            self.assertIn(self.must_ask('localize', photo, *which)['in_map'], ('office', 'copy'))
        here = must('localize', photo, '--map', files[0], '--map', files[1])
        self.assertEqual(here['localized'], True)
        self.assertEqual(len(here['answers']), 2)
        # A map of another camera that takes images of that size, and of one that does not.
        visit = self.folder / 'other_visit'
        if not visit.exists():
            must('synth', 'office', '--seed', 9, '--duration', 3, '--image-size', *SIZE, '--focal', FOCAL + 40, '--out', visit)
        must('run', visit, '--map', self.maps / 'other.cairn')
        failed = self.ask('localize', photo, '--map', 'copy,office,other')
        self.assertEqual(failed.code, 1, failed.out)
        self.assertRegex(failed.json['error'], rf'copy, office: .*{FOCAL}\.00 px; other: .*{FOCAL + 40}\.00 px.*--camera')
        failed = cairn('localize', photo, '--map', files[0], '--map', self.maps / 'other.cairn')
        self.assertIn(f'{self.maps}/other.cairn: ', failed.json['error'])
        small = self.folder / 'small.png'
        subprocess.run(['/usr/bin/python3', '-c', 'import sys; from PIL import Image; Image.open(sys.argv[1]).resize((100, 75)).save(sys.argv[2])',
                        photo, small], check=True)
        failed = self.ask('localize', small, '--map', 'copy,office')
        self.assertRegex(failed.json['error'], r'100x75 .*copy: 480x360; office: 480x360.*--camera')

    def test_top(self):
        self.ask('info', 'kitchen')
        self.assertEqual(self.server.get('/v1/maps/office')[0], 200)
        status = self.must_ask('top')
        self.assertEqual([m['name'] for m in status['maps']], ['office'])
        self.assertEqual(status['refused'], {'map_not_found': 1})
        self.assertGreater(status['uptime_s'], 0)
        once = cairn('--server', self.server.address, 'top', '--once', json_output=False)
        self.assertEqual(once.code, 0)
        self.assertTrue(all(len(line) <= 80 for line in once.out.splitlines()), once.out)
        self.assertIn('office', once.out)
        self.assertNotIn('\x1b', once.out)
        twice = cairn('--server', self.server.address, 'top', '--count', '2', '--interval', '0.1', json_output=False)
        self.assertEqual(twice.code, 0)
        self.assertEqual(twice.out.count('cairnd'), 2)
        self.assertIn('since the start', twice.out)
        self.assertIn('in the last', twice.out)
        self.assertEqual(cairn('top').code, 2)


if __name__ == '__main__':
    unittest.main()
