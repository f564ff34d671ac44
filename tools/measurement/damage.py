"""Maps that are damaged: flipped bits, truncated files, runs of random bytes. Whatever changes what a map says is found, no
verb crashes, and what can be saved is a good map."""
import json
import random
import subprocess

from .sessions import remove_map
from .work import CAIRN, Failed, cairn

ORDERLY = {0, 1, 3, 4}  # exit codes of a verb that met damage and said so, or did not meet it


def run(*arguments):
    """Exit code and answer of a verb; ends with Failed if it crashed or gave no reason."""
    done = subprocess.run([CAIRN, *map(str, arguments), '--json'], capture_output=True, text=True)
    if done.returncode not in ORDERLY:
        raise Failed(f'{arguments[0]} ended with {done.returncode}: {done.stderr[-300:]}')
    answer = json.loads(done.stdout)
    if done.returncode in (1, 3) and not (answer.get('error') or answer.get('findings')):
        raise Failed(f'{arguments[0]} gave no reason')
    return done.returncode, answer


class Damage:
    def damaged_base(self):
        def make():
            file = self.path('damage_base.cairn')
            visit = self.visit('office', 77, 1, '--duration', 4)
            cairn('run', visit, *self.mode, '--map', file, '--overwrite')
            return file, cairn('info', file, '--digest')
        return self.once('damaged_base', make)

    def map_of_bytes(self, bytes_):
        file = self.path('damaged.cairn')
        remove_map(file)
        file.write_bytes(bytes_)
        return file

    def recovered(self, file):
        """Keyframes of the map that `cairn recover` makes of it; 0 if there is nothing to be saved."""
        saved = self.path('damage_saved.cairn')
        remove_map(saved)
        code, answer = run('recover', file, saved)
        if code != 0:
            return 0
        if run('verify', saved, '--deep')[0] != 0:
            raise Failed('the recovered map is not good')
        return answer['keyframes']

    def flips(self):
        def count():
            base, info = self.damaged_base()
            good, chance = base.read_bytes(), random.Random(5)
            verbs = ['info', 'log', 'ls']
            counts = {'found': 0, 'harmless': 0, 'missed': 0, 'crashes': 0, 'kept': 0}
            for k in range(self.damages_wanted):
                bytes_ = bytearray(good)
                bytes_[chance.randrange(len(bytes_))] ^= 1 << chance.randrange(8)
                file = self.map_of_bytes(bytes_)
                try:
                    if run('verify', file, '--deep')[0] == 3:
                        counts['found'] += 1
                    elif run('info', file, '--digest')[1].get('digest') == info['digest']:
                        counts['harmless'] += 1
                    else:
                        counts['missed'] += 1
                    run(verbs[k % 3], file)
                    if k % 5 == 0:
                        counts['kept'] += self.recovered(file)
                except Failed as failed:
                    print(f'  flip {k}: {failed}', flush=True)
                    counts['crashes'] += 1
            recovered = len(range(0, self.damages_wanted, 5))
            return {**counts, 'kept': counts['kept'] / (recovered * info['keyframes'])}
        return self.once('flips', count)

    def cuts(self):
        def count():
            base, info = self.damaged_base()
            good, chance = base.read_bytes(), random.Random(6)
            counts = {'crashes': 0, 'missed': 0, 'kept': 0}
            wanted = max(1, self.damages_wanted // 2)
            for k in range(wanted):
                bytes_ = bytearray(good)
                if k % 2 == 0:
                    bytes_ = bytes_[:chance.randrange(1, len(bytes_))]
                else:
                    at, length = chance.randrange(len(bytes_)), 1 << chance.randrange(4, 17)
                    bytes_[at:at + length] = chance.randbytes(min(length, len(bytes_) - at))
                file = self.map_of_bytes(bytes_)
                try:
                    if run('verify', file)[0] == 0 and run('info', file, '--digest')[1]['digest'] != info['digest']:
                        counts['missed'] += 1
                    counts['kept'] += self.recovered(file)
                except Failed as failed:
                    print(f'  damage {k}: {failed}', flush=True)
                    counts['crashes'] += 1
            return {**counts, 'kept': counts['kept'] / (wanted * info['keyframes'])}
        return self.once('cuts', count)
