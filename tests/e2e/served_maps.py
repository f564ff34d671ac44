"""A cairnd for tests (environment variable CAIRND_BINARY)."""
import contextlib
import os
import signal
import socket
import subprocess
import threading
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


class Proxy:
    """Between clients and a server, to cut their connections."""

    def __init__(self, address):
        self.target = (address.split(':')[0], int(address.split(':')[1]))
        self.listener = socket.create_server(('127.0.0.1', 0))
        self.address = f'127.0.0.1:{self.listener.getsockname()[1]}'
        self.open, self.lock = set(), threading.Lock()
        threading.Thread(target=self.accept, daemon=True).start()

    def accept(self):
        while True:
            try:
                client, _ = self.listener.accept()
                server = socket.create_connection(self.target)
            except OSError:
                return
            with self.lock:
                self.open |= {client, server}
            for ends in ((client, server), (server, client)):
                threading.Thread(target=self.forward, args=ends, daemon=True).start()

    def forward(self, source, sink):
        try:
            while data := source.recv(1 << 16):
                sink.sendall(data)
        except OSError:
            pass
        self.close({source, sink})

    def close(self, sockets):
        for end in sockets:
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()

    def cut(self):
        with self.lock:
            ends, self.open = self.open, set()
        self.close(ends)

    def stop(self):
        self.listener.close()
        self.cut()
