"""A server beyond this machine, set up as docs/server.md says: certificates of openssl, tokens of cairnd, asked by cairn and over HTTP."""
import json
import pathlib
import shutil
import ssl
import subprocess
import tempfile
import time
import unittest
import urllib.error
import urllib.request

from cairn_cli import BINARY, cairn, must
from served_maps import DAEMON, Server


def run(*command):
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, timeout=60)
    if done.returncode != 0:
        raise AssertionError(f'{command}: {done.stdout}{done.stderr}')
    return done.stdout.strip()


@unittest.skipUnless(shutil.which('openssl'), 'there is no openssl to make certificates with')
class ProtectedServer(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = folder = pathlib.Path(tempfile.mkdtemp(prefix='cairn-e2e-'))
        cls.visit, cls.maps = folder / 'visit', folder / 'maps'
        cls.maps.mkdir()
        must('synth', 'office', '--seed', 4, '--duration', 4, '--image-size', 480, 360, '--focal', 315, '--out', cls.visit)
        must('run', cls.visit, '--deterministic', '--map', cls.maps / 'office.cairn')
        shutil.copy(cls.maps / 'office.cairn', cls.maps / 'secret.cairn')
        cls.photo = sorted((cls.visit / 'mav0/cam0/data').glob('*.png'))[7]
        for name in ('ca', 'other'):
            run('openssl', 'req', '-x509', '-newkey', 'ec', '-pkeyopt', 'ec_paramgen_curve:P-256', '-nodes', '-days', 2, '-subj', f'/CN={name}',
                '-keyout', folder / f'{name}.key', '-out', folder / f'{name}.pem')
        for name, alternative in (('server', 'DNS:localhost,IP:127.0.0.1'), ('robot', 'DNS:robot')):
            run('openssl', 'req', '-x509', '-newkey', 'ec', '-pkeyopt', 'ec_paramgen_curve:P-256', '-nodes', '-days', 2, '-subj', f'/CN={name}',
                '-addext', f'subjectAltName={alternative}', '-CA', folder / 'ca.pem', '-CAkey', folder / 'ca.key',
                '-addext', 'basicConstraints=CA:FALSE', '-keyout', folder / f'{name}.key', '-out', folder / f'{name}.pem')
        cls.tokens = folder / 'tokens.json'
        cls.reader = cls.token('reader', '--maps', 'office')
        cls.robot = cls.token('robot', '--maps', 'office,lab*', '--rights', 'extend', '--expires', '1d')
        cls.watcher = cls.token('watcher', '--maps', '*')
        cls.audit, cls.requests = folder / 'audit.jsonl', folder / 'requests.jsonl'
        cls.server = Server(cls.maps, '--tls-certificate', folder / 'server.pem', '--tls-key', folder / 'server.key', '--tokens', cls.tokens,
                            '--audit-log', cls.audit, '--request-log', cls.requests, address='0.0.0.0:0', tls=True)
        cls.context = ssl.create_default_context(cafile=str(folder / 'ca.pem'))

    @classmethod
    def tearDownClass(cls):
        code = cls.server.stop()
        shutil.rmtree(cls.folder)
        assert code == 0, f'the server ended with {code}'

    @classmethod
    def token(cls, name, *arguments):
        secret = run(DAEMON, 'token', 'create', name, *arguments, '--tokens', cls.tokens)
        (cls.folder / f'{name}.token').write_text(secret + '\n')
        return secret

    def ask(self, token, *arguments, ca='ca'):
        port = self.server.address.rsplit(':', 1)[1]
        extra = ['--token-file', self.folder / f'{token}.token'] if token else []
        return cairn('--server', f'localhost:{port}', '--ca', self.folder / f'{ca}.pem', *extra, *arguments)

    def get(self, path, token=None, headers=None, context=None):
        headers = dict(headers or {})
        if token:
            headers['Authorization'] = f'Bearer {token}'
        try:
            with urllib.request.urlopen(urllib.request.Request(self.server.url + path, headers=headers), timeout=20,
                                        context=context or self.context) as answer:
                return answer.status, answer.headers, answer.read().decode()
        except urllib.error.HTTPError as error:
            return error.code, error.headers, error.read().decode()

    def test_cairn_is_known_by_its_token(self):
        self.assertEqual([m['name'] for m in self.ask('reader', 'ls').json['maps']], ['office'])
        self.assertEqual([m['name'] for m in self.ask('watcher', 'ls').json['maps']], ['office', 'secret'])
        camera = self.folder / 'camera.yaml'
        camera.write_text('model: pinhole\nresolution_px: [480, 360]\nintrinsics_px: [315, 315, 239.5, 179.5]\n')
        found = self.ask('reader', 'localize', self.photo, '--camera', camera, '--map', 'office')
        self.assertEqual(found.code, 0, found.out)
        for name in ('secret', 'none'):
            refused = self.ask('reader', 'info', name)
            self.assertEqual(refused.code, 1)
            self.assertIn('does not give the right `read`', refused.json['error'])
        nobody = self.ask(None, 'ls')
        self.assertEqual(nobody.code, 1)
        self.assertIn('--token-file', nobody.json['error'])
        port = self.server.address.rsplit(':', 1)[1]
        done = subprocess.run([BINARY, '--server', f'localhost:{port}', '--ca', self.folder / 'ca.pem', 'ls'], capture_output=True, text=True,
                              env={'CAIRN_TOKEN': self.reader}, timeout=60)
        self.assertEqual(done.returncode, 0, done.stderr)

        done = subprocess.run([BINARY, '--server', f'localhost:{port}', 'ls'], capture_output=True, text=True,
                              env={'CAIRN_TOKEN': self.reader, 'CAIRN_CA': str(self.folder / 'ca.pem')}, timeout=60)
        self.assertEqual(done.returncode, 0, done.stderr)

    def test_a_secret_is_written_for_its_owner_alone(self):
        path = self.folder / 'written.token'
        self.assertEqual(run(DAEMON, 'token', 'create', 'written', '--maps', '*', '--output', path, '--tokens', self.tokens), '')
        self.assertEqual(path.stat().st_mode & 0o777, 0o600)
        self.assertEqual(self.get('/v1/maps', path.read_text().strip())[0], 200)
        again = subprocess.run([DAEMON, 'token', 'create', 'again', '--maps', '*', '--output', path, '--tokens', self.tokens],
                               capture_output=True, text=True, timeout=60)
        self.assertEqual(again.returncode, 1, 'it exists')
        self.assertNotIn('again', run(DAEMON, 'token', 'list', '--tokens', self.tokens), 'and nothing was created')

    def test_cairn_trusts_its_own_ca_only(self):
        refused = self.ask('reader', 'ls', ca='other')
        self.assertEqual(refused.code, 1)
        self.assertIn('--ca', refused.json['error'])

    def test_cairn_sends_no_token_in_the_clear(self):
        refused = cairn('--server', '192.0.2.1:7878', '--token-file', self.folder / 'reader.token', 'ls')
        self.assertEqual(refused.code, 1)
        self.assertIn('--token-in-clear', refused.json['error'])

    def test_http_over_tls(self):
        self.assertEqual(self.get('/v1/maps')[0], 401)
        status, headers, text = self.get('/v1/maps', self.reader, {'X-Request-Id': 'test-1'})
        self.assertEqual(status, 200, text)
        self.assertEqual(headers['X-Request-Id'], 'test-1')
        self.assertEqual([m['name'] for m in json.loads(text)['maps']], ['office'])
        self.assertEqual(self.get('/v1/maps/secret', self.reader)[0], 403)
        self.assertEqual(self.get('/metrics', self.reader)[0], 403)
        self.assertEqual(self.get('/metrics', self.watcher)[0], 200)
        self.assertEqual(self.get('/healthz')[0], 200)
        with self.assertRaises(urllib.error.URLError):
            self.get('/healthz', context=ssl.create_default_context(cafile=str(self.folder / 'other.pem')))
        lines = [json.loads(line) for line in self.requests.read_text().splitlines()]
        mine = [line for line in lines if line['request'] == 'test-1']
        self.assertEqual([(m['call'], m['token'], m['outcome']) for m in mine], [('Maps.ListMaps', 'reader', 'ok')])

    def test_who_changes_something_is_written_down(self):
        refused = self.ask('reader', 'run', self.visit, '--map', 'office', '--extend')
        self.assertEqual(refused.code, 1, refused.out)
        made = self.ask('robot', 'run', self.visit, '--map', 'lab_1')
        self.assertEqual(made.code, 0, made.out)
        time.sleep(1)  # who is not known leaves one line a second
        self.assertEqual(self.get('/v1/maps', 'cairn_unknown')[0], 401)
        lines = [json.loads(line) for line in self.audit.read_text().splitlines()]
        self.assertIn(('unknown_client', 'unauthenticated', '127.0.0.1'), [(a['action'], a['outcome'], a['peer']) for a in lines])
        lines = [line for line in lines if line['action'] != 'unknown_client']
        self.assertIn(('session_started', 'office', 'reader', 'permission_denied'), [(a['action'], a['map'], a['token'], a['outcome']) for a in lines])
        of_lab = [(a['action'], a['token'], a['outcome']) for a in lines if a['map'] == 'lab_1']
        self.assertEqual(of_lab, [('session_started_new_map', 'robot', 'ok'), ('session_finished', 'robot', 'ok')])

    def test_a_token_is_revoked_while_the_server_runs(self):
        secret = self.token('guest', '--maps', 'office')
        self.assertEqual(self.get('/v1/maps/office', secret)[0], 200)
        self.assertIn('guest', run(DAEMON, 'token', 'list', '--tokens', self.tokens))
        run(DAEMON, 'token', 'revoke', 'guest', '--tokens', self.tokens)
        self.assertNotIn('guest', run(DAEMON, 'token', 'list', '--tokens', self.tokens))
        self.assertEqual(self.get('/v1/maps/office', secret)[0], 401)
        self.assertEqual(self.tokens.stat().st_mode & 0o777, 0o600)
        self.assertNotIn(secret, self.tokens.read_text())

    def test_clients_may_need_certificates(self):
        server = Server(self.maps, '--tls-certificate', self.folder / 'server.pem', '--tls-key', self.folder / 'server.key',
                        '--tls-client-ca', self.folder / 'ca.pem', '--tokens', self.tokens, tls=True)
        try:
            common = ['--server', server.address.replace('127.0.0.1', 'localhost'), '--ca', self.folder / 'ca.pem',
                      '--token-file', self.folder / 'reader.token']
            self.assertEqual(cairn(*common, 'ls').code, 1)
            shown = ['--cert', self.folder / 'robot.pem', '--key', self.folder / 'robot.key']
            self.assertEqual(cairn(*common, *shown, 'ls').code, 0)
            context = ssl.create_default_context(cafile=str(self.folder / 'ca.pem'))
            context.load_cert_chain(str(self.folder / 'robot.pem'), str(self.folder / 'robot.key'))
            with urllib.request.urlopen(server.url + '/healthz', timeout=20, context=context) as answer:
                self.assertEqual(answer.status, 200)
        finally:
            server.stop()

    def test_mistakes_are_said_before_anybody_is_served(self):
        def refusal(*arguments):
            done = subprocess.run([DAEMON, '--maps', self.maps, '--check-config', *map(str, arguments)], capture_output=True, text=True, timeout=20)
            self.assertNotEqual(done.returncode, 0, done.stdout)
            return done.stderr
        own = ['--tls-certificate', self.folder / 'server.pem', '--tls-key', self.folder / 'server.key']
        self.assertIn('tokens (tokens) are missing', refusal('--listen', '0.0.0.0:1', *own))
        self.assertIn('TLS (tls_certificate, tls_key) is missing', refusal('--listen', '0.0.0.0:1', '--tokens', self.tokens))
        self.assertIn('does not belong to the certificate', refusal(*own[:3], self.folder / 'robot.key'))
        self.assertIn('none.pem', refusal(*own[:1], self.folder / 'none.pem', *own[2:]))
        self.assertIn('none.json', refusal(*own, '--tokens', self.folder / 'none.json'))
        self.assertIn('both tls_certificate and tls_key', refusal(*own[:2]))


if __name__ == '__main__':
    unittest.main(verbosity=2)
