"""Clients that mean no good, or do not know better: each is refused with a documented error, and the server goes on."""
import base64
import json
import pathlib
import re
import shutil
import signal
import socket
import struct
import tempfile
import unittest
import zlib

from cairn_cli import cairn, must
from served_maps import Server


def chunk(kind, body):
    return struct.pack('>I', len(body)) + kind + body + struct.pack('>I', zlib.crc32(kind + body))


def png(width, height, rows, before=b''):
    header = struct.pack('>IIBBBBB', width, height, 8, 0, 0, 0, 0)
    return b'\x89PNG\r\n\x1a\n' + chunk(b'IHDR', header) + before + chunk(b'IDAT', rows) + chunk(b'IEND', b'')


def blank_png(width, height):
    """A few kilobytes that become width x height."""
    squeeze = zlib.compressobj(9)
    rows = b''.join(squeeze.compress(b'\0' * (width + 1)) for _ in range(height)) + squeeze.flush()
    return png(width, height, rows)


def form(image, camera):
    body = b''
    for name, content in (('image', image), ('camera', camera.encode())):
        body += f'--xyz\r\nContent-Disposition: form-data; name="{name}"\r\n\r\n'.encode() + content + b'\r\n'
    return body + b'--xyz--\r\n'


def camera(width, height, focal=315):
    return json.dumps({'model': 'PINHOLE', 'params': [focal, focal, width / 2, height / 2]})


class HostileClients(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix='cairn-e2e-'))
        visit, cls.maps = cls.folder / 'visit', cls.folder / 'maps'
        cls.maps.mkdir()
        must('synth', 'office', '--seed', 4, '--duration', 4, '--image-size', 480, 360, '--focal', 315, '--out', visit)
        must('run', visit, '--deterministic', '--map', cls.maps / 'office.cairn')
        cls.digest = must('info', cls.maps / 'office.cairn', '--digest')['digest']
        cls.photo = sorted((visit / 'mav0/cam0/data').glob('*.png'))[20].read_bytes()
        cls.server = Server(cls.maps)

    @classmethod
    def tearDownClass(cls):
        # What they wrote is in the log as readable text.
        cls.server.process.send_signal(signal.SIGTERM)
        log = cls.server.process.communicate(timeout=20)[1]
        code = cls.server.process.returncode
        assert all(line[:2] == '20' and line.isprintable() for line in log.splitlines()), log
        digest = must('info', cls.maps / 'office.cairn', '--digest')['digest']
        shutil.rmtree(cls.folder)
        assert code == 0, f'the server ended with {code}'
        assert digest == cls.digest, 'the map was touched'

    def tearDown(self):
        """It is there, answers right, and has kept nothing."""
        self.assertIsNone(self.server.process.poll(), 'the server is alive')
        status, _, text = self.post(self.photo, camera(480, 360))
        self.assertEqual(status, 200, text)
        self.assertTrue(json.loads(text)['localized'], text)
        self.assertEqual(cairn('--server', self.server.address, 'ls').code, 0)
        pages = int(pathlib.Path(f'/proc/{self.server.process.pid}/statm').read_text().split()[1])
        self.assertLess(pages * 4096, 400e6)

    def post(self, image, camera_text, path='/v1/maps/office:localize'):
        return self.server.get(path, form(image, camera_text), 'multipart/form-data; boundary=xyz')

    def refused(self, answer, status=400):
        self.assertEqual(answer[0], status, answer)
        error = json.loads(answer[2])['error']
        self.assertTrue(error['reason'] and error['message'], error)

    def connect(self, address):
        host, port = address.rsplit(':', 1)
        return socket.create_connection((host, int(port)), timeout=20)

    def test_images_that_are_none_or_too_large(self):
        for image in (b'', b'GIF89a', b'\xff\xd8\xff', self.photo[:100], self.photo[:-5000], b'\x89PNG\r\n\x1a\n' + b'\0' * 50,
                      png(480, 360, b'no zlib'), png(480, 360, zlib.compress(b'\0' * 1000))):
            self.refused(self.post(image, camera(480, 360)))
        # What is claimed is not allocated, and what is too large is not decoded.
        self.refused(self.post(png(60000, 60000, zlib.compress(b'\0')), camera(60000, 60000)))
        self.refused(self.post(blank_png(5000, 5000), camera(5000, 5000)))
        self.refused(self.post(blank_png(2000, 2000), json.dumps({'model': 'PINHOLE', 'params': [1, 1, 1, 1], 'width': 480, 'height': 360})))
        # As large as is allowed: an answer, and a miss.
        status, _, text = self.post(blank_png(4000, 4000), camera(4000, 4000, 3000))
        self.assertEqual((status, json.loads(text)['stage']), (200, 'STAGE_FEATURES'))

    def test_texts_that_unpack_to_gigabytes(self):
        text = chunk(b'zTXt', b'x\0\0' + zlib.compress(b'\0' * 7_900_000, 9))
        rows = zlib.compress((b'\0' * 481) * 360)
        status, _, answer = self.post(png(480, 360, rows, before=150 * text), camera(480, 360))
        self.assertEqual((status, json.loads(answer)['stage']), (200, 'STAGE_FEATURES'))
        most = re.search(r'VmHWM:\s+(\d+) kB', pathlib.Path(f'/proc/{self.server.process.pid}/status').read_text())
        self.assertLess(int(most[1]) * 1024, 600e6)

    def test_cameras_that_make_no_sense(self):
        for params in ([0, 0, 240, 180], [-1, 1, 1, 1], [1e308, 1e308, 1, 1], [315, 315, 1e9, 180], [315, 315, 240], 'x', None):
            self.refused(self.post(self.photo, json.dumps({'model': 'PINHOLE', 'params': params})))
        for text in ('{"model":"PINHOLE","params":[1e999,1,1,1]}', '{"model":"PINHOLE","params":[NaN,1,1,1]}', '[' * 100000, '{"a":' * 100000,
                     '\x00\x01\x02', ''):
            self.refused(self.post(self.photo, text))
        # Numbers that are some, of a lens that nothing can be seen through.
        self.refused(self.post(self.photo, '{"model":"OPENCV_FISHEYE","params":[315,315,240,180,1e300,1e300,1e300,1e300]}'))

    def test_priors_that_make_no_sense(self):
        seen = {'model': 'MODEL_PINHOLE', 'width_px': 480, 'height_px': 360, 'fx_px': 315, 'fy_px': 315, 'cx_px': 239.5, 'cy_px': 179.5}
        pose = {'translation': {'x': 0, 'y': 0, 'z': 0}, 'rotation': {'x': 0, 'y': 0, 'z': 0, 'w': 1}}
        good = {'map_from_camera': pose, 'position_sigma': 'Infinity', 'rotation_sigma_rad': 'Infinity'}

        def ask(prior):
            request = {'image': {'encoded': base64.b64encode(self.photo).decode()}, 'camera': seen, 'prior': prior}
            return self.server.get('/v1/maps/office:localize', json.dumps(request).encode(), 'application/json')
        self.assertEqual(ask(good)[0], 200)
        for change in ({'position_sigma': 'NaN'}, {'position_sigma': -1}, {'rotation_sigma_rad': 'NaN'}, {'component': 77}, {'map_from_camera': {}},
                       {'map_from_camera': {**pose, 'translation': {'x': 'NaN'}}}, {'map_from_camera': {**pose, 'rotation': {'w': 2}}}):
            self.refused(ask({**good, **change}))

    def test_requests_that_are_none(self):
        def ask(body, kind='application/json', path='/v1/maps/office:localize'):
            return self.server.get(path, body, kind)
        for body in (b'', b'{', b'[]', b'null', b'{"image": 3}', b'{"image": {"gray": "!"}}', b'{"a":' * 100000, b'\xff\xfe'):
            self.refused(ask(body))
        self.refused(ask(b'--xyz', 'multipart/form-data; boundary=xyz'))
        self.refused(ask(b'x', 'multipart/form-data; boundary=' + 'y' * 100))
        for path in ('/v1/maps/..%2f..%2fetc%2fpasswd:localize', '/v1/maps/%00:localize', '/v1/maps/' + 'a' * 1000 + ':localize'):
            self.refused(ask(b'{}', path=path))
        self.refused(self.server.get('/v1/maps/../../etc/passwd'), 404)

    def test_what_is_not_http(self):
        for bytes_ in (b'\0' * 5000, b'GET', b'\x16\x03\x01\x02\x00\x01\x00', b'GET / HTTP/1.1\r\nContent-Length: -5\r\n\r\n',
                       b'GET / HTTP/1.1\r\n' + b'A: b\r\n' * 5000 + b'\r\n', b'POST /v1/maps/office:localize HTTP/1.1\r\n'
                       b'Content-Length: 99999999999999\r\n\r\n', b'POST / HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\nFFFFFFFFFFFFFFFFF\r\n'):
            with self.connect(self.server.url.removeprefix('http://')) as client:
                try:
                    client.sendall(bytes_)
                    client.shutdown(socket.SHUT_WR)
                    answer = client.recv(1000)
                except OSError:  # it has closed already
                    answer = b''
                self.assertTrue(answer == b'' or answer.startswith((b'HTTP/1.1 400', b'HTTP/1.1 413', b'HTTP/1.1 431')), answer)

    def test_what_is_not_grpc(self):
        preface = b'PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n'
        for bytes_ in (b'\0' * 5000, b'GET / HTTP/1.1\r\n\r\n', preface, preface + b'\xff' * 5000,
                       preface + b'\x00\x00\x00\x04\x00\x00\x00\x00\x00' + b'\xff\xff\xff\x01\x05\x00\x00\x00\x01' + b'\0' * 1000):
            with self.connect(self.server.address) as client:
                try:
                    client.sendall(bytes_)
                    client.shutdown(socket.SHUT_WR)
                    while client.recv(1000):
                        pass
                except ConnectionError:
                    pass

    def test_a_thousand_connections_that_say_nothing(self):
        held = [self.connect(self.server.address) for _ in range(800)]
        held += [self.connect(self.server.url.removeprefix('http://')) for _ in range(200)]
        try:
            for client in held[-50:]:
                client.sendall(b'POST /v1/maps/office:localize HTTP/1.1\r\nHost: x\r\nContent-Length: 1000\r\n\r\nhalf')
            self.assertEqual(self.server.get('/healthz')[0], 200)
            self.assertEqual(cairn('--server', self.server.address, 'info', 'office').code, 0)
        finally:
            for client in held:
                client.close()


if __name__ == '__main__':
    unittest.main(verbosity=2)
