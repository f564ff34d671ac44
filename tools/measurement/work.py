"""Running Cairn, and keeping what several checks share."""
import json
import os
import pathlib
import statistics
import subprocess
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
DATA = pathlib.Path(os.environ.get('CAIRN_DATA_DIR', ROOT.parent / 'shared' / 'data'))
CAIRN = pathlib.Path(os.environ.get('CAIRN_BINARY', ROOT / 'build' / 'release' / 'bin' / 'cairn'))


class Failed(Exception):
    pass


class Skipped(Exception):
    """What the check needs is not built."""


def cairn(*arguments, expect=(0,)):
    """Runs a verb with --json; its answer. `expect`: the exit codes that are no error."""
    command = [str(CAIRN), *map(str, arguments), '--json']
    with tempfile.TemporaryFile('w+') as out, tempfile.TemporaryFile('w+') as err:
        process = subprocess.Popen(command, stdout=out, stderr=err)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        out.seek(0), err.seek(0)
        stdout, stderr = out.read(), err.read()
    if process.returncode not in expect:
        raise Failed(f'exit {process.returncode}: {" ".join(command[1:])}: {(stdout + stderr).strip()[-300:]}')
    answer = json.loads(stdout) if stdout.strip() else {}
    answer['exit'] = process.returncode
    answer['peak_mb'] = usage.ru_maxrss / 1024
    return answer


def start(*arguments):
    """The same, running: to be watched and killed."""
    return subprocess.Popen([str(CAIRN), *map(str, arguments), '--json'], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def rendered(folder, *arguments):
    """A recording that `cairn synth` renders, unless it is there."""
    if not folder.exists():
        partial = folder.with_name(f'{folder.name}.partial')
        cairn('synth', *arguments, '--out', partial, '--overwrite')
        partial.rename(folder)
    return folder


def median_of_runs(runs, function):
    """Calls function(run) for each run; the median of each number in what it returns."""
    results = [function(run) for run in range(runs)]
    if runs > 1 and 'ate' in results[0]:
        print('        ATE of each run:', ', '.join(f'{result["ate"]:.4g}' for result in results), 'm', flush=True)
    return {key: statistics.median(result[key] for result in results) for key in results[0]}


class Work:
    """Results that several checks share, computed once; the modules beside this one add what can be measured."""

    def __init__(self, options, folder):
        self.folder, self.runs, self.seeds, self.cache = pathlib.Path(folder), options.runs, options.seeds, {}
        self.kills_wanted = options.kills
        self.damages_wanted = options.damages
        self.minutes, self.daemon_kills_wanted = options.minutes, options.daemon_kills
        self.worlds = pathlib.Path(options.worlds or folder)
        self.worlds.mkdir(parents=True, exist_ok=True)
        # Of the runs that make a map.
        self.mode = ['--deterministic'] if options.deterministic else ['--realtime'] if options.realtime else []

    def path(self, name):
        return self.folder / name

    def once(self, name, function):
        if name not in self.cache:
            try:
                self.cache[name] = function()
            except (Failed, Skipped) as error:
                self.cache[name] = error
        if isinstance(self.cache[name], (Failed, Skipped)):
            raise self.cache[name]
        return self.cache[name]
