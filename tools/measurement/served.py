"""Through a cairnd: clients that keep a copy of a map, many that track beside a session, and a daemon that is killed.

Rendered offices of 480x360 at 15 images a second, so that one machine can be the server and all of its clients."""
import json
import os
import random
import signal
import subprocess
import sys
import threading
import time

from .sessions import read
from .work import CAIRN, ROOT, Failed, cairn

os.environ.setdefault('CAIRND_BINARY', str(CAIRN.with_name('cairnd')))
sys.path.insert(0, str(ROOT / 'tests' / 'e2e'))
from served_maps import Server  # noqa: E402

SMALL = ['--image-size', 480, 360, '--focal', 315, '--rate', 15]
SESSIONS = 8  # at the daemon that is killed
BEHIND = 100  # revisions
TRACKER_SPEED, SESSION_SPEED = 0.25, 0.5  # of real time


def begin(server, *arguments, **more):
    """A client that runs beside others."""
    return subprocess.Popen([str(CAIRN), '--server', server.address, *map(str, arguments), '--json'], stdout=subprocess.PIPE,
                            stderr=subprocess.PIPE, text=True, **more)


def answer_of(client):
    out, err = client.communicate(timeout=900)
    if client.returncode != 0:
        raise Failed(f'exit {client.returncode}: {" ".join(client.args[1:])}: {(out + err).strip()[-300:]}')
    return json.loads(out)


def stored_bytes(value):
    """Of a value in a row: with the byte that says what it is."""
    if value is None:
        return 1
    if isinstance(value, int):
        return 1 + (0 if value in (0, 1) else next(n for n in (1, 2, 3, 4, 6, 8) if -2**(8 * n - 1) <= value < 2**(8 * n - 1)))
    return 9 if isinstance(value, float) else 2 + len(value)


def changed_bytes(map_file, since):
    """Of the rows that were put since a revision and are there."""
    tables = ['cameras', 'sessions', 'components', 'keyframes', 'keyframe_features', 'keyframe_points', 'points']
    rows = [row for table in tables for row in read(map_file, f'SELECT * FROM {table} WHERE revision > ?', since)]
    # Edges have no revision of their own: those between keyframes that were put.
    rows += read(map_file, 'SELECT * FROM covisibility WHERE keyframe_a IN (SELECT id FROM keyframes WHERE revision > ?1) '
                           'AND keyframe_b IN (SELECT id FROM keyframes WHERE revision > ?1)', since)
    return sum(stored_bytes(value) for row in rows for value in row)


def resident_mb(process):
    for line in open(f'/proc/{process.pid}/status'):
        if line.startswith('VmRSS:'):
            return int(line.split()[1]) / 1024
    raise Failed('the daemon is gone')


class Served:
    def served_folder(self, name):
        folder = self.path(name)
        folder.mkdir(parents=True, exist_ok=True)
        for file in folder.iterdir():
            file.unlink()
        return folder

    def behind(self):
        """A copy of a map whose connection is let go of while sessions extend the map, and that then catches up."""
        def one():
            maps = self.served_folder('behind')
            visits = [self.visit('office', 31, k, '--duration', s, *SMALL) for k, s in ((1, 10), (2, 20))]
            server = Server(maps)
            answer_of(begin(server, 'run', visits[0], '--map', 'office'))
            copy = begin(server, 'bench', 'follow', '--map', 'office', '--away', stdin=subprocess.PIPE)
            said = copy.stderr.readline()
            if 'away at revision' not in said:
                raise Failed(said + copy.communicate()[1])
            away = int(said.split('away at revision')[1].split(':')[0])
            while cairn('--server', server.address, 'info', 'office')['revision'] < away + BEHIND:
                answer_of(begin(server, 'run', visits[1], '--map', 'office', '--extend'))
            copy.stdin.write('\n')
            copy.stdin.flush()
            report = answer_of(copy)
            server.stop()
            caught, file = report['catch_up'], maps / 'office.cairn'
            changed = changed_bytes(file, caught['from_revision'])
            result = {'behind': caught['to_revision'] - caught['from_revision'], 'ratio': caught['bytes'] / changed,
                      'views': caught['views'], 'same': report['digest'] == cairn('info', file, '--digest')['digest'],
                      'mb': caught['bytes'] / 1e6, 'view_mb': report['view']['bytes'] / 1e6, 'ms': 1000 * caught['elapsed_s']}
            print(f'        follow: {result}', flush=True)
            return result
        return self.once('behind', one)

    def beside(self, trackers, give_way=False):
        """Sessions that extend a map, one after the other, and as many trackers beside them in the same map; these give way
        to the server and the sessions (nice 10), as if they had processors of their own, or do not."""
        def one():
            maps = self.served_folder(f'beside_{trackers}_{give_way}')
            visits = [self.visit('office', 31, k, '--duration', s, *SMALL) for k, s in ((1, 10), (2, 20), (3, 10))]
            server = Server(maps)
            answer_of(begin(server, 'run', visits[0], '--map', 'office'))
            until = time.monotonic() + 60 * self.minutes
            first = cairn('--server', server.address, 'info', 'office')['revision']
            wrong, revisions, memory, frames = [], [], [], [0, 0]

            def track(k):
                states = self.path(f'beside_{k}.txt')
                while time.monotonic() < until and not wrong:
                    states.unlink(missing_ok=True)
                    try:
                        report = answer_of(begin(server, 'track', visits[2], '--map', 'office', '--realtime', TRACKER_SPEED,
                                                 '--states', states, preexec_fn=(lambda: os.nice(10)) if give_way else None))
                    except Failed as error:
                        wrong.append(str(error))
                        return
                    rows = [line.split() for line in states.read_text().splitlines() if not line.startswith('#')]
                    revisions.extend(int(row[6]) for row in rows)
                    frames[0] += report['frames']
                    frames[1] += report['frames'] - report['lost']
            threads = [threading.Thread(target=track, args=(k,)) for k in range(trackers)]
            for thread in threads:
                thread.start()
            sessions = []
            while time.monotonic() < until and not wrong:
                session = begin(server, 'run', visits[1], '--map', 'office', '--extend', '--realtime', SESSION_SPEED)
                sessions.append(answer_of(session))
                memory.append(resident_mb(server.process))
            for thread in threads:
                thread.join()
            idle = resident_mb(server.process)
            server.stop()
            if wrong:
                raise Failed(wrong[0])
            last = cairn('info', maps / 'office.cairn')
            latencies = [session['latency_ms'] for session in sessions]
            result = {'stall_ms': max(l['max'] for l in latencies), 'p99_ms': max(l['p99'] for l in latencies),
                      'median_ms': max(l['median'] for l in latencies), 'unknown': sum(not first <= r <= last['revision'] for r in revisions),
                      'revisions': len(set(revisions)), 'posed': frames[1] / max(1, frames[0]), 'sessions': len(sessions),
                      'memory_mb': memory, 'idle_mb': idle, 'keyframes': last['keyframes']}
            # Per keyframe that was added after the first session.
            result['grown'] = memory[-1] / memory[0]
            print(f'        {trackers} trackers{", giving way" if give_way else ""}: {result}', flush=True)
            return result
        return self.once(f'beside {trackers} {give_way}', one)

    def daemon_kills(self):
        """Sessions at a daemon that is killed again and again at random moments, and started again at once."""
        def one():
            moments, results = random.Random(5), {'kills': 0, 'ready_s': 0.0, 'lost': 0, 'failed': 0, 'break_s': 0.0, 'damaged': 0}
            visits = [self.visit('office', 31, k, '--duration', 20, *SMALL) for k in range(4, 4 + SESSIONS)]
            while results['kills'] < self.daemon_kills_wanted:
                self.kill_under_sessions(visits, moments, results)
            return results
        return self.once('daemon kills', one)

    def kill_under_sessions(self, visits, moments, results):
        """For as long as these visits are mapped, each into a map of its own."""
        maps = self.served_folder('daemon_killed')
        server = Server(maps)
        lives = [self.path(f'daemon_killed_{i}.txt') for i in range(len(visits))]
        for live in lives:
            live.unlink(missing_ok=True)
        clients = [begin(server, 'run', visit, '--map', f'office_{i}', '--realtime', 0.25, '--live-poses', live)
                   for i, (visit, live) in enumerate(zip(visits, lives))]
        while results['kills'] < self.daemon_kills_wanted:
            time.sleep(moments.uniform(6.0, 11.0))
            if any(client.poll() is not None for client in clients):
                break
            told = {m['name']: m['revision'] for m in cairn('--server', server.address, 'ls')['maps']}
            server.stop(signal.SIGKILL)
            begun = time.monotonic()
            server = Server(maps, address=server.address)
            ready = time.monotonic() - begun
            now = {m['name']: m.get('revision', 0) for m in cairn('--server', server.address, 'ls')['maps']}
            lost = sum(now.get(name, 0) < revision for name, revision in told.items())
            results['kills'] += 1
            results['lost'] += lost
            results['ready_s'] = max(results['ready_s'], ready)
            print(f'        kill {results["kills"]}: ready after {ready:.2f} s, {lost} maps behind what was told', flush=True)
        breaks = []
        for client, live in zip(clients, lives):
            try:
                answer_of(client)
            except Failed as error:
                print(f'        {error}', flush=True)
                results['failed'] += 1
                continue
            at = [float(line.split()[0]) for line in live.read_text().splitlines() if not line.startswith('#')]
            breaks.append(max((b - a for a, b in zip(at, at[1:])), default=float('inf')))
        server.stop()
        results['break_s'] = max([results['break_s'], *breaks])
        results['damaged'] += sum(len(cairn('verify', file, expect=(0, 3)).get('findings', [])) > 0 for file in maps.glob('*.cairn'))
        print(f'        breaks {sorted(round(b, 2) for b in breaks)} s', flush=True)
