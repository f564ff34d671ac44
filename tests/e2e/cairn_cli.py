"""Runs the `cairn` binary (environment variable CAIRN_BINARY) for tests."""
import json
import os
import resource
import struct
import subprocess
import zlib

BINARY = os.environ['CAIRN_BINARY']


class Answer:
    def __init__(self, done):
        self.code, self.out, self.err = done.returncode, done.stdout, done.stderr

    @property
    def json(self):
        return json.loads(self.out)


def cairn(*arguments, json_output=True, most_bytes=None):
    """`most_bytes`: no file can become larger, as if the disk were full."""
    command = [BINARY, *map(str, arguments)]
    if json_output:
        command.append('--json')

    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (most_bytes, most_bytes))
    return Answer(subprocess.run(command, capture_output=True, text=True, timeout=900, preexec_fn=limit if most_bytes else None))


def black_png(width, height):
    def chunk(kind, data):
        return struct.pack('>I', len(data)) + kind + data + struct.pack('>I', zlib.crc32(kind + data))
    rows = zlib.compress(bytes(height * (width + 1)))
    return (b'\x89PNG\r\n\x1a\n' + chunk(b'IHDR', struct.pack('>IIBBBBB', width, height, 8, 0, 0, 0, 0)) +
            chunk(b'IDAT', rows) + chunk(b'IEND', b''))


def must(*arguments):
    """The JSON answer of a call that has to succeed."""
    answer = cairn(*arguments)
    if answer.code != 0:
        raise AssertionError(f'exit {answer.code}: cairn {" ".join(map(str, arguments))}: {answer.out}{answer.err}')
    return answer.json
