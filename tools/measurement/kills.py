"""Sessions that extend a map and are killed at random moments: the file must be a good map, with all that any reader had
seen of it, and go on from there."""
import random
import shutil
import sqlite3
import time

from .sessions import read, remove_map
from .work import Failed, cairn, start

PER_MAP = 25  # kills of one file, one after the other, before it starts anew
VISIT_S, AFTERWARDS_S = 6, 3  # of video: of the session that is killed, and of the one that goes on


def watched(process, map_file, enough, until_s, wait_s=0.01):
    """Reads the map beside a running session until enough(*answer) or for so long, or until it ends; the last answer:
    revision, newest session, its keyframes."""
    last, deadline = (0, 0, 0), time.monotonic() + until_s
    while process.poll() is None and time.monotonic() < deadline and not enough(*last):
        try:
            last = read(map_file, 'SELECT revision, newest, (SELECT COUNT(*) FROM keyframes WHERE session = newest) '
                                  'FROM map, (SELECT MAX(id) AS newest FROM sessions)')[0]
        except sqlite3.OperationalError:  # not there yet, or busy
            pass
        time.sleep(min(wait_s, max(0.0, deadline - time.monotonic())))
    return last


def kill(process):
    process.kill()
    process.wait()


class Kills:
    def killed_in_the_other_room(self, visit, map_file):
        """Kills the session once it has some keyframes; whether the component that they are in is in the file."""
        process = start('run', visit, *self.mode, '--map', map_file, '--extend')
        _, session, keyframes = watched(process, map_file, lambda _, session, count: session == 2 and count >= 4, 120)
        early = process.poll() is None
        kill(process)
        if not early or session != 2:
            raise Failed('the session ended before it could be killed')
        info = cairn('info', map_file)
        return len(info['components']) == 2 and info['components'][1]['keyframes'] >= keyframes - 1  # one may be culled

    def kills(self):
        def one():
            moments, file, base = random.Random(12), self.path('killed.cairn'), self.path('killed_base.cairn')
            visits = [self.visit('office', 99, k, '--duration', s) for k, s in ((1, 9), (2, VISIT_S), (3, AFTERWARDS_S))]
            cairn('run', visits[0], '--map', base, '--overwrite')
            shutil.copy(base, file)
            began = time.monotonic()
            cairn('run', visits[1], '--map', file, '--extend')
            whole_s = time.monotonic() - began
            counts = {'damaged': 0, 'lost': 0, 'stuck': 0}
            for k in range(self.kills_wanted):
                if k % PER_MAP == 0:
                    remove_map(file)
                    shutil.copy(base, file)
                process = start('run', visits[1], '--map', file, '--extend')
                seen, *_ = watched(process, file, lambda *_: False, moments.uniform(0.0, whole_s))
                kill(process)
                wrong = self.what_is_wrong(file, seen, visits[2])
                if wrong:
                    print(f'        kill {k + 1}: {wrong}', flush=True)
                    counts[wrong[0]] += 1
                    shutil.copy(file, self.path(f'killed_{k + 1}.cairn'))
                    remove_map(file)
                    shutil.copy(base, file)
            return counts
        return self.once('kills', one)

    @staticmethod
    def what_is_wrong(file, seen, visit):
        try:
            info = cairn('info', file)
        except Failed as error:
            return 'damaged', str(error)
        if info['revision'] < seen:
            return 'lost', f'revision {info["revision"]}, a reader had seen {seen}'
        try:
            cairn('run', visit, '--map', file, '--extend')
        except Failed as error:
            return 'stuck', str(error)
        after = cairn('info', file)['revision']
        return ('stuck', f'still at revision {after}') if after <= info['revision'] else None
