"""A cairnd for tests (environment variable CAIRND_BINARY)."""
import os
import signal
import subprocess
import urllib.error
import urllib.request

DAEMON = os.environ['CAIRND_BINARY']


class Server:
    """A cairnd on loopback ports that are free, or on `address` for gRPC."""

    def __init__(self, maps, *arguments, address='127.0.0.1:0', tls=False):
        self.process = subprocess.Popen([DAEMON, '--maps', str(maps), '--listen', address, '--listen-http', '127.0.0.1:0',
                                         *map(str, arguments)],
                                        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        line = self.process.stdout.readline()
        if 'gRPC on ' not in line:
            raise AssertionError(f'{line}{self.process.stderr.read()}')
        self.address = line.split('gRPC on ')[1].split(',')[0].strip()
        self.url = f"{'https' if tls else 'http'}://{line.split('HTTP on ')[1].strip()}"

    def get(self, path, body=None, content_type=None):
        """Status, content type and body of an answer over HTTP."""
        request = urllib.request.Request(self.url + path, data=body, headers={'Content-Type': content_type} if content_type else {})
        try:
            with urllib.request.urlopen(request, timeout=20) as answer:
                return answer.status, answer.headers['Content-Type'], answer.read().decode()
        except urllib.error.HTTPError as error:
            return error.code, error.headers['Content-Type'], error.read().decode()

    def stop(self, sent=signal.SIGTERM):
        self.process.send_signal(sent)
        self.process.communicate(timeout=20)
        return self.process.returncode
