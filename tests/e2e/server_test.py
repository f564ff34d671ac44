"""A server of maps, as its users see it: cairnd, and cairn --server."""
import json
import pathlib
import re
import shutil
import signal
import subprocess
import tempfile
import time
import unittest
import urllib.request

from cairn_cli import BINARY, cairn, must
from served_maps import DAEMON, Server


class ServedMaps(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix='cairn-e2e-'))
        cls.visit, cls.maps = cls.folder / 'visit', cls.folder / 'maps'
        cls.maps.mkdir()
        cls.map = cls.maps / 'office.cairn'
        size = ['--image-size', 480, 360, '--focal', 315]
        must('synth', 'office', '--seed', 4, '--duration', 5, *size, '--out', cls.visit)
        must('run', cls.visit, '--deterministic', '--map', cls.map)
        must('align', cls.map, '--groundtruth', cls.visit / 'groundtruth_cam0.txt')
        cls.digest = must('info', cls.map, '--digest')['digest']
        cls.server = Server(cls.maps)

    @classmethod
    def tearDownClass(cls):
        cls.server.stop()
        shutil.rmtree(cls.folder)

    def ask(self, *arguments, server=None):
        return cairn('--server', server or self.server.address, *arguments)

    def test_lists_and_describes_what_the_directory_has(self):
        served = self.ask('ls')
        self.assertEqual(served.code, 0, served.out)
        here, there = must('ls', self.maps)['maps'], served.json['maps']
        for name in ('name', 'id', 'revision', 'keyframes', 'points', 'bytes'):
            self.assertEqual([m[name] for m in here], [m[name] for m in there])
        described = self.ask('info', 'office').json
        of_file = must('info', self.map)
        self.assertEqual(described, of_file)
        told = cairn('--server', self.server.address, 'info', 'office', json_output=False).out
        here = cairn('info', self.map, json_output=False).out
        self.assertEqual(told.split('\n', 1)[1], here.split('\n', 1)[1], 'but for the first line, which names it')
        self.assertIn('office', cairn('--server', self.server.address, 'ls', json_output=False).out)

    def test_locates_as_the_file_does(self):
        out = {}
        arguments = [self.visit, '--stride', 15, '--independent', '--out']
        for name, extra in (('local', ['--map', self.map]), ('served', ['--map', 'office'])):
            out[name] = self.folder / f'{name}.txt'
            answer = (must if name == 'local' else lambda *a: self.ask(*a).json)('localize', *arguments, out[name], *extra)
            self.assertEqual(answer['localized'], answer['frames'])
            self.assertEqual(answer['frame'], 'world')
        self.assertEqual(out['local'].read_text(), out['served'].read_text())
        self.assertEqual(must('info', self.map, '--digest')['digest'], self.digest, 'the map is not touched')

    def test_a_photo(self):
        photo = sorted((self.visit / 'mav0/cam0/data').glob('*.png'))[7]
        camera = self.folder / 'camera.yaml'
        camera.write_text('model: pinhole\nresolution_px: [480, 360]\nintrinsics_px: [315, 315, 239.5, 179.5]\n')
        answer = self.ask('localize', photo, '--camera', camera, '--map', 'office')
        self.assertEqual(answer.code, 0, answer.out)
        self.assertTrue(answer.json['localized'])
        # Its features say the same; the camera may be given as EuRoC does.
        by_features = self.ask('localize', photo, '--camera', self.visit / 'mav0/cam0/sensor.yaml', '--map', 'office', '--send', 'features')
        self.assertEqual(by_features.code, 0, by_features.out)
        self.assertEqual(by_features.json['position'], answer.json['position'])
        self.assertEqual(cairn('localize', photo, '--camera', camera, '--map', self.map, '--send', 'features').code, 2)
        both = self.ask('localize', photo, '--camera', camera, '--map', 'office', '--all-maps')
        self.assertEqual((both.code, 'one of the two' in both.json['error']), (2, True))
        # A map that is not there is told, and the others answer.
        across = self.ask('localize', photo, '--camera', camera, '--map', 'office,kitchen')
        self.assertEqual((across.code, across.json['in_map']), (0, 'office'), across.out)
        self.assertIn('no map', [a['error'] for a in across.json['answers'] if a['in_map'] == 'kitchen'][0])

    def test_makes_and_exports_maps(self):
        made = self.ask('create', 'cellar', '--title', 'Cellar')
        self.assertEqual((made.code, made.json['keyframes']), (0, 0), made.out)
        self.assertEqual(self.ask('create', 'cellar').code, 1)
        self.assertEqual(self.ask('delete', 'cellar').code, 0)
        self.assertEqual(must('create', self.folder / 'attic.cairn')['keyframes'], 0)
        exported = self.folder / 'exported.cairn'
        with urllib.request.urlopen(f'{self.server.url}/v1/maps/office:export', timeout=20) as answer:
            self.assertEqual(answer.headers['Content-Disposition'], 'attachment; filename="office.cairn"')
            exported.write_bytes(answer.read())
        self.assertEqual(must('info', exported, '--digest')['digest'], self.digest)
        poses = [line for line in self.server.get('/v1/maps/office:export?content=trajectory')[2].splitlines() if line[0] != '#']
        self.assertEqual(len(poses), must('info', self.map)['keyframes'])
        self.assertEqual(self.server.get('/v1/maps/office:export?content=soup')[0], 400)
        self.assertEqual(self.server.get('/v1/maps/office/log?count=abc')[0], 400)
        self.assertEqual(len(json.loads(self.server.get('/v1/maps/office/log?max_count=1')[2])['changes']), 1)

    def test_top_ends_with_its_reader(self):
        top = subprocess.Popen([BINARY, '--server', self.server.address, 'top', '--interval', '0.1'], stdout=subprocess.PIPE)
        self.assertIn(b'cairnd', top.stdout.readline())
        top.stdout.close()
        self.assertIn(top.wait(timeout=20), (141, -signal.SIGPIPE))

    def test_a_photo_by_curl(self):
        if not shutil.which('curl'):
            self.skipTest('there is no curl')
        photo = sorted((self.visit / 'mav0/cam0/data').glob('*.png'))[7]
        done = subprocess.run(['curl', '-sS', '-F', f'image=@{photo}', '-F', 'camera={"model":"PINHOLE","params":[315,315,240,180]}',
                               f'{self.server.url}/v1/maps/office:localize'], capture_output=True, text=True, timeout=20)
        answer = json.loads(done.stdout)
        self.assertTrue(answer['localized'], done.stdout)
        camera = self.folder / 'curl.yaml'
        camera.write_text('model: pinhole\nresolution_px: [480, 360]\nintrinsics_px: [315, 315, 239.5, 179.5]\n')
        local = must('localize', photo, '--camera', camera, '--map', self.map)
        position = answer['world_from_camera']['translation']
        self.assertEqual([position[axis] for axis in 'xyz'], local['position'])

    def test_what_watches_it(self):
        self.assertEqual(self.server.get('/healthz')[0], 200)
        self.assertEqual(self.server.get('/readyz')[0], 200)
        self.assertIn('/v1/maps/{map}:localize', json.loads(self.server.get('/openapi.json')[2])['paths'])
        self.ask('info', 'kitchen')
        status, kind, text = self.server.get('/metrics')
        self.assertEqual((status, kind), (200, 'text/plain; version=0.0.4; charset=utf-8'))
        self.assertIn('cairn_calls_total{call="Admin.OverviewMap",reason="map_not_found"}', text)
        for line in text.splitlines():
            self.assertRegex(line, r'^(# (HELP|TYPE) .+|[a-z_]+(\{[^}]*\})? [-+0-9.eEinfNa]+)$')
        status, kind, text = self.server.get('/v1/maps/kitchen')
        self.assertEqual((status, kind), (404, 'application/json'))
        self.assertEqual(json.loads(text)['error']['reason'], 'map_not_found')
        self.assertEqual(self.server.get('/v1/maps/office:localize', b'{}', 'application/json')[0], 400)

    def test_errors_say_what_to_do(self):
        missing = self.ask('info', 'kitchen')
        self.assertEqual(missing.code, 1)
        self.assertEqual(missing.json['fault'], 'not_found')
        self.assertIn('kitchen', missing.json['error'])
        self.assertEqual(self.ask('info', '../office').code, 1)
        nobody = self.ask('ls', server='127.0.0.1:9')
        self.assertEqual(nobody.code, 1)
        self.assertIn('is cairnd running there?', nobody.json['error'])
        self.assertEqual(self.ask('info', 'none', '--digest').code, 1)
        self.assertEqual(cairn('ls').code, 2)

    def test_refuses_what_it_should_not_do(self):
        def refusal(*arguments):
            done = subprocess.run([DAEMON, *map(str, arguments)], capture_output=True, text=True, timeout=20)
            self.assertNotEqual(done.returncode, 0)
            return done.stderr
        self.assertIn('--without-protection', refusal('--maps', self.maps, '--listen', '0.0.0.0:0'))
        self.assertIn('is it taken', refusal('--maps', self.maps, '--listen', self.server.address))
        self.assertIn('no directory', refusal('--maps', self.folder / 'nowhere'))

    def test_settings(self):
        config = self.folder / 'cairnd.yaml'

        def check(text, *arguments):
            config.write_text(text)
            done = subprocess.run([DAEMON, '--config', config, '--check-config', *arguments], capture_output=True, text=True, timeout=20)
            return done.returncode, done.stdout + done.stderr
        self.assertEqual(check(f'maps: {self.maps}\nmemory_mb: 100\n')[0], 0)
        code, said = check(f'maps: {self.maps}\nmemroy_mb: 100\n')
        self.assertEqual(code, 2)
        self.assertIn('cairnd.yaml:2: unknown key `memroy_mb`', said)
        self.assertEqual(check('memory_mb: 100\n')[0], 2, 'no directory')
        self.assertEqual(check('maps: /not/there\n')[0], 1)
        code, said = check(f'maps: {self.maps}\n', '--max-calls', '0')
        self.assertEqual((code, '--max-calls must be 8 to 10000, not 0' in said), (2, True), said)
        self.assertEqual(check(f'maps: {self.maps}\naudit_log: /not/there/audit.jsonl\n')[0], 1)
        self.assertEqual(check('memory_mb: 100\n', '--maps', str(self.maps))[0], 0)
        self.assertEqual(check(f'maps: {self.maps}\nlisten: 0.0.0.0:1\n')[0], 1)
        self.assertEqual(check(f'maps: {self.maps}\nlisten: 0.0.0.0:1\n', '--listen', '127.0.0.1:1')[0], 0, 'options count more')
        shipped = pathlib.Path(__file__).resolve().parents[2] / 'server/daemon/cairnd.yaml'
        everything = shipped.read_text().replace('/var/lib/cairn\n', f'{self.maps}\n').replace('# ', '').split('\n\n', 1)[1]
        self.assertEqual(check(everything)[0], 0, 'what the example shows as standards')

    def test_the_unit_of_systemd(self):
        unit = pathlib.Path(DAEMON).parents[1] / 'server/daemon/cairnd.service'
        if not shutil.which('systemd-analyze'):
            self.skipTest('there is no systemd-analyze')
        text = re.sub(r'ExecStart=\S+', f'ExecStart={DAEMON}', unit.read_text())
        text = re.sub(r'Documentation=.*', '', text)
        copied = self.folder / 'cairnd.service'
        copied.write_text(text)
        done = subprocess.run(['systemd-analyze', 'verify', copied], capture_output=True, text=True, timeout=60)
        self.assertNotIn('cairnd.service', done.stderr)

    def test_stops_in_order(self):
        for sent in (signal.SIGTERM, signal.SIGINT):
            server = Server(self.maps)
            self.assertEqual(self.ask('ls', server=server.address).code, 0)
            begun = time.monotonic()
            self.assertEqual(server.stop(sent), 0)
            self.assertLess(time.monotonic() - begun, 5)

    def test_stops_in_order_after_a_large_answer(self):
        # gRPC may look for ten seconds whether a connection takes the rest of one: of a map of 10 MB most times.
        maps = self.folder / 'large'
        maps.mkdir()
        must('synth', 'map', '--like', self.maps / 'office.cairn', '--keyframes', 60, '--out', maps / 'office.cairn')
        for i in range(5):
            server = Server(maps)
            drawn = self.ask('render', 'office', '-o', self.folder / f'large_{i}.png', server=server.address)
            self.assertEqual(drawn.code, 0, drawn.out)
            begun = time.monotonic()
            self.assertEqual(server.stop(), 0)
            self.assertLess(time.monotonic() - begun, 5)


if __name__ == '__main__':
    unittest.main()
