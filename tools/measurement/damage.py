"""Maps that are damaged: flipped bits, in the file and in what its rows say, truncated files, runs of random bytes. Whatever
changes what a map says is found, no verb crashes, and what can be saved is a good map."""
import json
import random
import shutil
import sqlite3
import struct
import subprocess

from .sessions import remove_map
from .work import CAIRN, Failed, cairn

ORDERLY = {0, 1, 3, 4}  # exit codes of a verb that met damage and said so, or did not meet it
FEW = ['--tests', 2]


def run(*arguments):
    """Exit code and answer of a verb; ends with Failed if it crashed or gave no reason."""
    done = subprocess.run([CAIRN, *map(str, arguments), '--json'], capture_output=True, text=True, timeout=300)
    if done.returncode not in ORDERLY:
        raise Failed(f'{arguments[0]} ended with {done.returncode}: {(done.stdout + done.stderr)[-300:]}')
    answer = json.loads(done.stdout)
    if done.returncode in (1, 3) and not (answer.get('error') or answer.get('findings')):
        raise Failed(f'{arguments[0]} gave no reason')
    return done.returncode, answer


def spoil_a_value(database, chance):
    """Flips a bit of one value of a row, of all that there are by their size; which one."""
    columns = []
    for table, in database.execute("SELECT name FROM sqlite_master WHERE type = 'table' AND name NOT LIKE 'sqlite_%'").fetchall():
        for _, column, *_ in database.execute(f'PRAGMA table_info({table})').fetchall():
            size, = database.execute(f'SELECT total(max(length({column}), 1)) FROM {table}').fetchone()
            columns.append((table, column, size))
    while True:
        (table, column, _), = chance.choices(columns, [size for *_, size in columns])
        rows, = database.execute(f'SELECT count(*) FROM {table}').fetchone()
        if rows == 0:
            continue
        offset = chance.randrange(rows)
        value, kind = database.execute(f'SELECT {column}, typeof({column}) FROM {table} LIMIT 1 OFFSET {offset}').fetchone()
        spoiled = flipped(value, kind, chance)
        if spoiled is None:
            continue
        keys = [row[1] for row in database.execute(f'PRAGMA table_info({table})').fetchall() if row[5]]
        where = ' AND '.join(f'{key} = ?' for key in keys)
        at = database.execute(f'SELECT {", ".join(keys)} FROM {table} LIMIT 1 OFFSET {offset}').fetchone()
        try:
            database.execute(f'UPDATE {table} SET {column} = ? WHERE {where}', (spoiled, *at))
        except sqlite3.IntegrityError:  # the id of another row: SQLite would not find two
            continue
        return f'{table}.{column}'


def flipped(value, kind, chance):
    if kind == 'blob' and value:
        bytes_ = bytearray(value)
        bytes_[chance.randrange(len(bytes_))] ^= 1 << chance.randrange(8)
        return bytes(bytes_)
    if kind == 'text' and value:
        at = chance.randrange(len(value))
        return value[:at] + chr(ord(value[at]) ^ 1 << chance.randrange(5)) + value[at + 1:]
    if kind == 'integer':
        return struct.unpack('<q', struct.pack('<Q', struct.unpack('<Q', struct.pack('<q', value))[0] ^ 1 << chance.randrange(64)))[0]
    if kind == 'real':
        bits, = struct.unpack('<Q', struct.pack('<d', value))
        real, = struct.unpack('<d', struct.pack('<Q', bits ^ 1 << chance.randrange(64)))
        return real if real == real else None  # SQLite makes NULL of what is no number
    return None


class Damage:
    def damaged_base(self):
        def make():
            file = self.path('damage_base.cairn')
            visit = self.visit('office', 77, 1, '--duration', 4)
            cairn('run', visit, *self.mode, '--map', file, '--overwrite')
            cairn('align', file, '--groundtruth', visit / 'groundtruth_cam0.txt')
            other = self.path('damage_other.cairn')
            cairn('run', self.visit('office', 77, 2, '--duration', 4), *self.mode, '--map', other, '--overwrite')
            return file, cairn('info', file, '--digest'), visit
        return self.once('damaged_base', make)

    def map_of_bytes(self, bytes_):
        file = self.path('damaged.cairn')
        remove_map(file)
        file.write_bytes(bytes_)
        return file

    def any_verb(self, k, file):
        """The k-th of all that look at a map or make something of it, with the damaged one; those that change it, last."""
        base, _, visit = self.damaged_base()
        out, other = self.path('damage_out'), self.path('damage_out.cairn')
        shutil.rmtree(out, ignore_errors=True)
        out.mkdir()
        remove_map(other)
        image = sorted((visit / 'mav0/cam0/data').glob('*'))[20 + k % 50]
        verbs = [('info', file), ('info', file, '--plan'), ('log', file), ('ls', file, 'keyframes'), ('ls', file, 'points'),
                 ('show', file, 'keyframe', 1 + k % 5), ('show', file, 'session', 1), ('show', file, 'camera', 1), ('stats', file),
                 ('coverage', file, '--views', 2), ('explain', file, image), ('localize', image, '--map', file),
                 ('track', visit, '--map', file, '--mode', 'features', '--stride', 20),
                 ('render', file, '-o', out / 'plan.png'), ('diff', base, file), ('diff', file, '--since', 2), ('snapshot', file, other),
                 ('pack', file, '--localization-only', '-o', other, *FEW), ('merge', self.path('damage_other.cairn'), file, '-o', other),
                 ('merge', file, self.path('damage_other.cairn'), '-o', other), ('split', file, '--by', 'session', '-o', out),
                 ('export', file, out / 'model', '--format', 'colmap'), ('export', file, out / 'all.json'), ('export', file, out / 'poses.txt'),
                 ('prune', file, '--dry-run', *FEW), ('synth', 'map', '--like', file, '--keyframes', 20, '--out', other), ('verify', file),
                 ('compact', file), ('prune', file, *FEW), ('align', file, '--gravity', 'cameras', '--overwrite'),
                 ('align', file, '--groundtruth', visit / 'groundtruth_cam0.txt', '--overwrite'), ('session', 'remove', file, 1)]
        return run(*verbs[k % len(verbs)])

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
        """Bits of the file, free room and all."""
        def count():
            base, info, _ = self.damaged_base()
            good, chance = base.read_bytes(), random.Random(5)
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
                    if k % 5 == 0:
                        counts['kept'] += self.recovered(file)
                    self.any_verb(k, file)
                except Failed as failed:
                    print(f'  flip {k}: {failed}', flush=True)
                    counts['crashes'] += 1
            recovered = len(range(0, self.damages_wanted, 5))
            return {**counts, 'kept': counts['kept'] / (recovered * info['keyframes'])}
        return self.once('flips', count)

    def spoiled_values(self):
        """Bits of what rows say: every one is found."""
        def count():
            base, _, _ = self.damaged_base()
            chance, file = random.Random(7), self.path('damaged.cairn')
            counts = {'missed': 0, 'crashes': 0}
            for k in range(self.damages_wanted):
                remove_map(file)
                shutil.copy(base, file)
                database = sqlite3.connect(file)
                database.execute('PRAGMA ignore_check_constraints = ON')
                with database:
                    where = spoil_a_value(database, chance)
                database.close()
                try:
                    if run('verify', file, '--deep')[0] != 3:
                        print(f'  value {k}: {where} is not found', flush=True)
                        counts['missed'] += 1
                    self.any_verb(k, file)
                except Failed as failed:
                    print(f'  value {k}, {where}: {failed}', flush=True)
                    counts['crashes'] += 1
            return counts
        return self.once('spoiled_values', count)

    def cuts(self):
        def count():
            base, info, _ = self.damaged_base()
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
                    self.any_verb(k, file)
                except Failed as failed:
                    print(f'  damage {k}: {failed}', flush=True)
                    counts['crashes'] += 1
            return {**counts, 'kept': counts['kept'] / (wanted * info['keyframes'])}
        return self.once('cuts', count)
