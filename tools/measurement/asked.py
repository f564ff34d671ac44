"""Locating JPEG photos in a map of about a thousand keyframes through a cairnd: over gRPC and REST, and by their features."""
import http.client
import json
import multiprocessing
import os
import shutil
import statistics
import subprocess
import sys
import time
import urllib.parse
import uuid

from .served import Server, answer_of, begin
from .work import CAIRN, DATA, ROOT, Failed, Skipped, cairn

QUALITY = 90  # of the photos
PHOTOS, ASKED = 60, 300  # different ones, and how often one of them is asked for


def percentile(values, share):
    return sorted(values)[min(len(values) - 1, int(share * len(values)))]


def form(photo, camera):
    """The body of a request, and its content type."""
    border = uuid.uuid4().hex
    parts = [f'--{border}\r\nContent-Disposition: form-data; name="camera"\r\n\r\n{camera}\r\n'.encode(),
             f'--{border}\r\nContent-Disposition: form-data; name="image"; filename="photo.jpg"\r\n\r\n'.encode(), photo,
             f'\r\n--{border}--\r\n'.encode()]
    return b''.join(parts), f'multipart/form-data; boundary={border}'


def pinhole_of(path):
    """COLMAP's parameters of a camera.yaml without distortion: pixel centres at (0.5, 0.5)."""
    numbers = next(line for line in path.read_text().splitlines() if line.startswith('intrinsics_px')).split('[')[1].split(']')[0]
    fx, fy, cx, cy = (float(n) for n in numbers.split(','))
    return [fx, fy, cx + 0.5, cy + 0.5]


def ask_over_rest(work):
    """One client's share of the photos: milliseconds of each answer, and how many were located."""
    host, port, requests, first, clients = work
    connection, times, located = http.client.HTTPConnection(host, port, timeout=60), [], 0
    for i in range(first, ASKED, clients):
        body, kind = requests[i % len(requests)]
        begun = time.perf_counter()
        connection.request('POST', '/v1/maps/large:localize', body, {'Content-Type': kind})
        answer = connection.getresponse()
        text = answer.read()
        times.append(1e3 * (time.perf_counter() - begun))
        located += answer.status == 200 and json.loads(text)['localized']
    return times, located


class Asked:
    def photos(self):
        """Images of redkitchen after the map's, as JPEG files with their camera: a folder that verbs read."""
        def one():
            if not DATA.is_dir():
                raise Skipped(f'no sequences at {DATA}')
            from PIL import Image
            folder = self.path('photos')
            folder.mkdir(parents=True, exist_ok=True)
            names = sorted(path for path in (DATA / 'redkitchen' / 'rgb').iterdir() if path.suffix in ('.png', '.jpg'))
            for name in names[::max(1, len(names) // PHOTOS)][:PHOTOS]:
                Image.open(name).convert('L').save(folder / f'{name.stem}.jpg', quality=QUALITY)
            (folder / 'camera.yaml').write_text((DATA / 'redkitchen' / 'camera.yaml').read_text())
            return folder
        return self.once('photos', one)

    def over_rest(self, server, folder, clients):
        """Milliseconds of each answer, and answers per second; each client is a process, as clients are."""
        camera = json.dumps({'model': 'PINHOLE', 'params': pinhole_of(folder / 'camera.yaml')})
        requests = [form(path.read_bytes(), camera) for path in sorted(folder.glob('*.jpg'))]
        address = urllib.parse.urlparse(server.url)
        with multiprocessing.get_context('fork').Pool(clients) as pool:
            begun = time.perf_counter()
            answers = pool.map(ask_over_rest, [(address.hostname, address.port, requests, k, clients) for k in range(clients)], chunksize=1)
            elapsed = time.perf_counter() - begun
        times = [ms for of_client, _ in answers for ms in of_client]
        if not times:
            raise Failed('nothing was answered')
        return {'median_ms': statistics.median(times), 'p99_ms': percentile(times, 0.99),
                'located': sum(located for _, located in answers) / len(times), 'per_s': len(times) / elapsed}

    def asked(self):
        def one():
            maps, folder = self.served_folder('asked'), self.photos()
            shutil.copy(self.large_map(), maps / 'large.cairn')  # no link leads out of the directory
            server = Server(maps)
            result = {'keyframes': cairn('--server', server.address, 'info', 'large')['keyframes'], 'jpeg_bytes': statistics.mean(p.stat().st_size for p in folder.glob('*.jpg'))}
            for send in ('file', 'image', 'features'):
                for clients in (1, 2):
                    bench = answer_of(begin(server, 'bench', 'server', folder, '--map', 'large', '--send', send, '--clients', clients,
                                            '--count', ASKED))
                    result[f'{send}_{clients}'] = {
                        'median_ms': bench['latency_ms']['median'], 'p99_ms': bench['latency_ms']['p99'],
                        'per_s': bench['answers_per_s'], 'located': bench['localized'] / bench['answers'],
                        'server_ms': bench['server_ms']['median'], 'bytes': bench['request_bytes']}
            for clients in (1, 2):
                result[f'rest_{clients}'] = self.over_rest(server, folder, clients)
            server.stop()
            print(f'        asked: {json.dumps(result)}', flush=True)
            return result
        return self.once('asked', one)

    def hostile(self):
        """tests/e2e/hostile_clients_test.py against this build."""
        def one():
            done = subprocess.run([sys.executable, '-m', 'unittest', 'hostile_clients_test'], cwd=ROOT / 'tests' / 'e2e', capture_output=True, text=True,
                                  env={**os.environ, 'CAIRN_BINARY': str(CAIRN), 'CAIRND_BINARY': os.environ['CAIRND_BINARY']})
            said = done.stderr.strip().splitlines()
            tests = int(next(line for line in said if line.startswith('Ran ')).split()[1])
            return {'tests': tests, 'failed': sum(line.startswith(('FAIL:', 'ERROR:')) for line in said) + (tests == 0)}
        return self.once('hostile', one)
