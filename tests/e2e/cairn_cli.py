"""Runs the `cairn` binary (environment variable CAIRN_BINARY) for tests."""
import json
import os
import resource
import subprocess

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


def must(*arguments):
    """The JSON answer of a call that has to succeed."""
    answer = cairn(*arguments)
    if answer.code != 0:
        raise AssertionError(f'exit {answer.code}: cairn {" ".join(map(str, arguments))}: {answer.out}{answer.err}')
    return answer.json
