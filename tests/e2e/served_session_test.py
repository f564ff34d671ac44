"""Sessions over the network: they make maps and extend them, and survive cut connections and a killed server."""
import json
import pathlib
import shutil
import signal
import subprocess
import tempfile
import time
import unittest

from cairn_cli import BINARY, cairn, must
from served_maps import Proxy, Server


def times(path):
    return [float(line.split()[0]) for line in path.read_text().splitlines() if not line.startswith('#')]


class ServedSessions(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix='cairn-e2e-'))
        size = ['--image-size', 480, 360, '--focal', 315]
        cls.first, cls.second = cls.folder / 'first', cls.folder / 'second'
        must('synth', 'office', '--seed', 4, '--duration', 8, *size, '--out', cls.first)
        must('synth', 'office', '--seed', 4, '--session', 2, '--duration', 8, *size, '--out', cls.second)

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    def setUp(self):
        self.maps = pathlib.Path(tempfile.mkdtemp(prefix='maps-', dir=self.folder))
        self.server = Server(self.maps)

    def tearDown(self):
        if self.server.process.poll() is None:
            self.server.stop()

    def run_served(self, *arguments):
        answer = cairn('--server', self.server.address, 'run', *arguments)
        self.assertEqual(answer.code, 0, f'{answer.out}{answer.err}')
        return answer.json

    def test_makes_a_map_and_extends_it(self):
        out, live = self.folder / 'frames.txt', self.folder / 'live.txt'
        made = self.run_served(self.first, '--map', 'office', '--trajectory', out, '--live-poses', live)
        self.assertEqual(made['result'], 'created')
        self.assertGreater(made['tracked_share'], 0.9)
        self.assertEqual(len(times(out)), made['frames_with_final_pose'])
        self.assertEqual(len(times(live)), made['live_poses'])
        error = must('eval', 'ate', out, self.first / 'groundtruth_cam0.txt')
        self.assertLess(error['ate_m'], 0.02, error)
        extended = self.run_served(self.second, '--map', 'office', '--extend')
        self.assertEqual(extended['result'], 'located')
        self.assertEqual(extended['joins'], 1)
        for arguments, remedy in (('office',), 'give --extend to add this session to it'), (('none', '--extend'), 'leave --extend out to make it'):
            refused = cairn('--server', self.server.address, 'run', self.first, '--map', *arguments)
            self.assertEqual(refused.code, 1, refused.out)
            self.assertIn(remedy, refused.json['error'])
        self.assertEqual(cairn('--server', self.server.address, 'run', self.first, '--map', 'x', '--deterministic').code, 2)
        self.assert_status_is_of(extended['revision'])
        tracked = cairn('--server', self.server.address, 'track', self.second, '--map', 'office')
        self.assertEqual(tracked.code, 0, tracked.out)
        self.assertEqual(tracked.json['with_pose_share'], 1.0)
        self.assertEqual((tracked.json['tracked_at'], tracked.json['frames_without_server']), ('client', 0))
        # What comes too fast is a frame of the camera all the same.
        fast = cairn('--server', self.server.address, 'track', self.second, '--map', 'office', '--realtime', 50, json_output=False)
        self.assertRegex(fast.out, f"a pose for [0-9]+ of {tracked.json['frames']} frames")
        self.assertRegex(fast.out, '[0-9]+ frames came too fast: they were not tracked')
        there = cairn('--server', self.server.address, 'track', self.second, '--map', 'office', '--server-side')
        self.assertEqual((there.json['tracked_at'], there.json['with_pose_share']), ('server', 1.0))
        self.assertEqual(cairn('--server', self.server.address, 'track', self.second, '--map', 'office', '--mode', 'features').code, 0)
        copy = cairn('--server', self.server.address, 'bench', 'follow', '--map', 'office')
        self.assertEqual(copy.json['digest'], must('info', self.maps / 'office.cairn', '--digest')['digest'])
        self.assertEqual(cairn('--server', self.server.address, 'track', self.second, '--map', 'none').code, 1)
        self.assertEqual(cairn('--server', self.server.address, 'track', self.second, '--map', 'office', '--mode', 'features',
                               '--server-side').code, 2)
        # The file is an ordinary map once the server has let go of it.
        self.assertEqual(self.server.stop(), 0)
        info = must('info', self.maps / 'office.cairn')
        self.assertEqual([s['complete'] for s in info['sessions']], [True, True])
        self.assertEqual(info['revision'], extended['revision'])

    def test_says_when_it_is_found_and_joined(self):
        self.run_served(self.first, '--map', 'office')
        answer = cairn('--server', self.server.address, 'run', self.second, '--until', 3, '--map', 'office', '--extend', json_output=False)
        self.assertEqual(answer.code, 0, f'{answer.out}{answer.err}')
        self.assertRegex(answer.err, r'looks like component 1 after \d')
        self.assertRegex(answer.err, r'joined to component 1 at \d')

    def assert_status_is_of(self, revision):
        """Without anybody having asked for the map since."""
        status = must('--server', self.server.address, 'top')
        self.assertEqual([(m['name'], m['revision'], m['writing']) for m in status['maps']], [('office', revision, False)])
        stored = (self.maps / 'office.cairn').stat().st_size
        self.assertGreater(status['maps'][0]['memory_bytes'], stored)
        self.assertIn(f'cairn_map_revision{{map="office"}} {revision}\n', self.server.get('/metrics')[2])

    def begin(self, *arguments):
        return subprocess.Popen([BINARY, '--server', self.server.address, 'run', *map(str, arguments), '--json'],
                                stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def wait_for_keyframes(self, name, count):
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline:
            answer = cairn('--server', self.server.address, 'info', name)
            if answer.code == 0 and answer.json['keyframes'] >= count:
                return answer.json
            time.sleep(0.1)
        self.fail(f'{name} never had {count} keyframes')

    def test_a_killed_server_loses_nothing_that_it_told_of(self):
        live = self.folder / 'killed.txt'
        # Half as fast: a busy machine must begin anew in what is left of the recording.
        client = self.begin(self.first, '--map', 'office', '--realtime', 0.5, '--live-poses', live, '--overwrite')
        told = self.wait_for_keyframes('office', 5)
        self.server.stop(signal.SIGKILL)
        begun = time.monotonic()
        self.server = Server(self.maps, address=self.server.address)
        self.assertLess(time.monotonic() - begun, 1.0, 'serves at once')
        after = cairn('--server', self.server.address, 'info', 'office')
        self.assertEqual(after.code, 0, after.out)
        self.assertGreaterEqual(after.json['revision'], told['revision'])
        self.assertGreaterEqual(after.json['keyframes'], told['keyframes'])
        out, err = client.communicate(timeout=120)
        self.assertEqual(client.returncode, 0, out + err)
        told = json.loads(out)
        self.assertGreater(told['frames_before_restart'], 0, 'which have no final pose, and that is said')
        # The camera's frames waited for the server: what came before the kill may be replaced on a busy machine.
        self.assertLess(told['longest_gap_s'], 0.75)
        self.assertIn('waiting for the server', err)
        # The client went on by itself, in a further session of the same map.
        info = must('info', self.maps / 'office.cairn')
        self.assertEqual([s['complete'] for s in info['sessions']], [False, True])
        found = times(live)
        last = times(self.first / 'groundtruth_cam0.txt')[-1]
        self.assertGreater(found[-1], last - 0.5, 'poses until the end')

    def test_poses_of_before_a_join_outlive_a_killed_server(self):
        must('run', self.first, '--map', self.maps / 'office.cairn')
        live, trajectory = self.folder / 'joined.live', self.folder / 'joined.txt'
        client = self.begin(self.second, '--map', 'office', '--extend', '--realtime', 0.5, '--live-poses', live, '--trajectory',
                            trajectory, '--overwrite')
        deadline = time.monotonic() + 60
        while not any(c.get('joined_into') for c in must('--server', self.server.address, 'info', 'office')['components']):
            self.assertIsNone(client.poll(), 'the session has ended before it was joined')
            self.assertLess(time.monotonic(), deadline)
            time.sleep(0.1)
        time.sleep(1.0)
        self.server.stop(signal.SIGKILL)
        self.server = Server(self.maps, address=self.server.address)
        out, err = client.communicate(timeout=120)
        self.assertEqual(client.returncode, 0, out + err)
        told = json.loads(out)
        self.assertGreater(told['poses_as_answered'], 0)
        # Those that were answered in the session's own component are where that was joined to.
        self.assertRegex(live.read_text(), '^# component 2')
        self.assertAlmostEqual(times(trajectory)[0], times(live)[0], delta=1e-6)
        error = must('eval', 'ate', trajectory, self.second / 'groundtruth_cam0.txt')
        self.assertLess(error['ate_m'], 0.03)

    def test_nobody_elses_map_is_extended_after_a_restart(self):
        theirs = self.folder / 'theirs'
        theirs.mkdir()
        must('run', self.second, '--map', theirs / 'office.cairn', '--until', 3)
        digest = must('info', theirs / 'office.cairn', '--digest')['digest']
        client = self.begin(self.first, '--map', 'office', '--realtime', 0.5)
        deadline = time.monotonic() + 30
        while not must('--server', self.server.address, 'top')['sessions']:
            self.assertLess(time.monotonic(), deadline)
            time.sleep(0.1)
        self.server.stop(signal.SIGKILL)
        # While it was away somebody else's map got the name.
        self.server = Server(theirs, address=self.server.address)
        out, err = client.communicate(timeout=60)
        self.assertEqual(client.returncode, 1, out + err)
        self.assertIn('another map by now', out + err)
        self.assertEqual(self.server.stop(), 0)
        self.assertEqual(must('info', theirs / 'office.cairn', '--digest')['digest'], digest)

    def test_a_connection_that_breaks_while_it_is_finished_costs_nothing(self):
        proxy = Proxy(self.server.address)
        self.addCleanup(proxy.stop)
        frames, out = len(times(self.first / 'groundtruth_cam0.txt')), self.folder / 'finished.txt'
        client = subprocess.Popen([BINARY, '--server', proxy.address, 'run', self.first, '--map', 'office', '--trajectory', out, '--json'],
                                  stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        answered = 0
        while answered < frames and client.poll() is None:
            sessions = must('--server', self.server.address, 'top')['sessions']
            answered = sessions[0]['frames'] if sessions else answered
        proxy.cut()
        said, err = client.communicate(timeout=60)
        self.assertEqual(client.returncode, 0, said + err)
        report = json.loads(said)
        self.assertEqual((report['result'], report['frames_before_restart']), ('created', 0), err)
        self.assertEqual(len(times(out)), report['frames_with_final_pose'])
        self.assertEqual(self.server.stop(), 0)
        self.assertEqual(len(must('info', self.maps / 'office.cairn')['sessions']), 1, 'it was mapped once')

    def localize_until_killed(self, *arguments):
        """A client that locates images, and a server that is gone while it does."""
        self.run_served(self.first, '--map', 'office')
        client = subprocess.Popen([BINARY, '--server', self.server.address, *map(str, arguments), '--map', 'office', '--json'],
                                  stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        deadline = time.monotonic() + 30
        while not any(work['per_s'] for name, work in must('--server', self.server.address, 'top')['work'].items()
                      if name != 'sessions'):
            self.assertLess(time.monotonic(), deadline)
            time.sleep(0.05)
        self.server.stop(signal.SIGKILL)
        return client

    def test_who_locates_images_waits_for_a_server_that_is_started_again(self):
        for verb in (['localize', self.second, '--independent'], ['track', self.second, '--server-side']):
            with self.subTest(verb=verb[0]):
                client = self.localize_until_killed(*verb)
                time.sleep(2)
                self.server = Server(self.maps, address=self.server.address)
                out, err = client.communicate(timeout=120)
                self.assertEqual(client.returncode, 0, out + err)
                self.assertEqual(json.loads(out)['frames'], len(times(self.second / 'groundtruth_cam0.txt')), err)
                self.assertIn('waiting for the server', err)
                self.server.stop()
                (self.maps / 'office.cairn').unlink()
                self.server = Server(self.maps, address=self.server.address)

    def test_ctrl_c_ends_the_wait_for_a_server(self):
        client = self.localize_until_killed('localize', self.second, '--independent')
        time.sleep(1.5)
        begun = time.monotonic()
        client.send_signal(signal.SIGINT)
        out, err = client.communicate(timeout=20)
        self.assertLess(time.monotonic() - begun, 5)
        self.assertEqual(client.returncode, 130, out + err)
        self.assertGreater(json.loads(out)['frames'], 0, 'what was done until then')

    def test_images_go_as_they_are_whatever_their_size(self):
        for width, height in ((320, 240), (1280, 800)):
            name = f'of_{width}'
            visit = self.folder / name
            must('synth', 'office', '--duration', 2.5, '--image-size', width, height, '--out', visit)
            self.assertGreater(must('--server', self.server.address, 'run', visit, '--map', name)['keyframes'], 2)

    def test_stops_in_time_while_a_session_runs(self):
        client = self.begin(self.first, '--map', 'office', '--realtime', 1)
        self.wait_for_keyframes('office', 5)
        begun = time.monotonic()
        self.assertEqual(self.server.stop(), 0)
        self.assertLess(time.monotonic() - begun, 5.0)
        client.kill()
        client.communicate()
        self.assertGreaterEqual(must('info', self.maps / 'office.cairn')['keyframes'], 5)

    def test_a_session_whose_client_is_gone_is_finished(self):
        self.server.stop()
        audit = self.folder / 'audit.jsonl'
        self.server = Server(self.maps, '--session-wait-s', 1, '--audit-log', audit)
        client = self.begin(self.first, '--map', 'office', '--realtime', 1)
        self.wait_for_keyframes('office', 5)
        client.kill()
        client.communicate()
        deadline = time.monotonic() + 30
        while not cairn('--server', self.server.address, 'info', 'office').json['sessions'][0]['complete']:
            self.assertLess(time.monotonic(), deadline)
            time.sleep(0.2)
        self.assertEqual(self.server.stop(), 0)
        lines = [json.loads(line) for line in audit.read_text().splitlines()]
        self.assertEqual([(a['action'], a['outcome']) for a in lines],
                         [('session_started_new_map', 'ok'), ('session_left', 'ok'), ('session_abandoned', 'ok')])
        self.assertGreater(lines[-1]['details']['frames'], 5)
        self.assertEqual({line['peer'] for line in lines}, {'127.0.0.1'}, 'whose session it was')

    def test_what_a_session_of_seconds_has_left_is_named(self):
        elsewhere = self.folder / 'elsewhere'
        must('synth', 'office', '--seed', 11, '--duration', 2.5, '--image-size', 480, 360, '--focal', 315, '--out', elsewhere)
        self.run_served(self.first, '--map', 'office')
        whole = cairn('--server', self.server.address, 'info', 'office')
        self.assertEqual(whole.json['fragments'], [])
        self.assertEqual(self.run_served(elsewhere, '--map', 'office', '--extend')['result'], 'apart')
        told = cairn('--server', self.server.address, 'info', 'office').json['fragments']
        self.assertEqual([(f['component'], f['session']) for f in told], [(2, 2)])
        self.server.stop(signal.SIGKILL)
        self.assertEqual(must('info', self.maps / 'office.cairn')['fragments'], told)
        self.server = Server(self.maps)
        said = cairn('--server', self.server.address, 'info', 'office', json_output=False).out
        self.assertIn('cairn session remove office 2', ' '.join(said.split()))
        self.assertEqual(cairn('--server', self.server.address, 'session', 'remove', 'office', 2).code, 0)
        self.assertEqual(cairn('--server', self.server.address, 'info', 'office').json['fragments'], [])

    def test_a_session_that_was_cut_off_says_how_far_it_came(self):
        client = self.begin(self.first, '--map', 'office', '--realtime', 1)
        self.wait_for_keyframes('office', 5)
        self.server.stop(signal.SIGKILL)
        client.kill()
        client.communicate()
        self.server = Server(self.maps)
        said = cairn('--server', self.server.address, 'info', 'office', json_output=False).out
        self.assertRegex(' '.join(said.split()), r'session 1: .* (?!0\.0)[0-9.]+ s, .*\(cut off before its end\)')


if __name__ == '__main__':
    unittest.main(verbosity=2)
