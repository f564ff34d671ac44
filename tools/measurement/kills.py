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

    def care_kills(self):
        """Verbs that change a map, or make one, killed at random moments: the map is as before or as it should be, a new
        one is there whole or not at all, and the same verb does it afterwards."""
        def one():
            moments, file, out = random.Random(13), self.path('care.cairn'), self.path('care_out')
            base, _, visit = self.damaged_base()
            other, both, model = self.path('damage_other.cairn'), self.path('care_both.cairn'), self.path('care_model')
            shutil.copy(base, both)
            cairn('run', self.visit('office', 77, 2), *self.mode, '--map', both, '--extend')
            cairn('export', base, model, '--format', 'colmap', '--images', visit, '--overwrite')
            verbs = [['session', 'remove', both, 2], ['prune', both, '--redundancy', 0.5, '--tests', 0], ['compact', both],
                     ['align', both, '--gravity', 'cameras', '--overwrite'],
                     ['pack', base, '--localization-only', '--tests', 0, '-o', out / 'x.cairn'],
                     ['merge', base, other, '-o', out / 'x.cairn'], ['split', both, '--by', 'session', '-o', out],
                     ['import', 'colmap', model, '--images', model / 'images', '-o', out / 'x.cairn'],
                     ['snapshot', base, out / 'x.cairn'], ['synth', 'map', '--like', base, '--keyframes', 30, '--out', out / 'x.cairn']]
            counts = {'damaged': 0, 'partial': 0, 'stuck': 0}
            for k in range(self.kills_wanted):
                verb = verbs[k % len(verbs)]
                changes = verb[0] in ('session', 'prune', 'compact', 'align')
                call = [file if word is both else word for word in verb]

                def begin_anew():
                    remove_map(file)
                    shutil.rmtree(out, ignore_errors=True)
                    out.mkdir()
                    shutil.copy(both, file)
                begin_anew()
                before, began = cairn('info', file, '--digest')['digest'], time.monotonic()
                cairn(*call)
                whole_s, after = time.monotonic() - began, cairn('info', file, '--digest')['digest']
                begin_anew()
                process = start(*call)
                time.sleep(moments.uniform(0.0, whole_s))
                kill(process)
                try:
                    for made in out.glob('*.cairn'):
                        if cairn('verify', made, '--deep')['findings'] or not cairn('info', made)['keyframes']:
                            counts['partial'] += 1
                    if cairn('verify', file, '--deep')['findings'] or cairn('info', file, '--digest')['digest'] not in (before, after):
                        counts['damaged'] += 1
                    # Once more: it does it, or was done already.
                    cairn(*call, *([] if changes or verb[0] == 'snapshot' else ['--overwrite']),
                          expect=(0, 1) if verb[0] in ('session', 'snapshot') else (0,))
                    if not changes and not list(out.glob('*.cairn')):
                        counts['stuck'] += 1
                except Failed as error:
                    print(f'        kill {k + 1}, {verb[0]}: {error}', flush=True)
                    counts['damaged'] += 1
            return counts
        return self.once('care_kills', one)
