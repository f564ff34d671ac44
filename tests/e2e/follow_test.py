"""A tracker that keeps the map at the client: it follows a session that extends the map, and goes on while the server is
killed and comes back."""
import json
import pathlib
import shutil
import signal
import subprocess
import tempfile
import time
import unittest

from cairn_cli import BINARY, cairn, must
from served_maps import Server


class Follow(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix='cairn-e2e-'))
        size = ['--image-size', 480, 360, '--focal', 315]
        cls.visits = [cls.folder / f'visit_{k}' for k in (1, 2, 3)]
        for k, visit in enumerate(cls.visits, 1):
            must('synth', 'office', '--seed', 4, '--session', k, '--duration', 8, *size, '--out', visit)

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    def begin(self, *arguments):
        return subprocess.Popen([BINARY, '--server', self.server.address, *map(str, arguments), '--json'],
                                stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def test_goes_on_without_the_server_and_says_so(self):
        maps = self.folder / 'maps'
        maps.mkdir()
        self.server = Server(maps)
        states, poses = self.folder / 'states.txt', self.folder / 'poses.txt'
        made = cairn('--server', self.server.address, 'run', self.visits[0], '--map', 'office')
        self.assertEqual(made.code, 0, made.out)
        tracker = self.begin('track', self.visits[2], '--map', 'office', '--realtime', 0.25, '--states', states,
                             '--out', poses)
        session = self.begin('run', self.visits[1], '--map', 'office', '--extend', '--realtime', 0.4)
        deadline = time.monotonic() + 60
        while cairn('--server', self.server.address, 'info', 'office').json['revision'] < made.json['revision'] + 10:
            self.assertLess(time.monotonic(), deadline, 'the session never came to anything')
            time.sleep(0.1)
        self.server.stop(signal.SIGKILL)
        time.sleep(1.5)  # an outage that lasts
        self.server = Server(maps, address=self.server.address)
        out, err = tracker.communicate(timeout=120)
        self.assertEqual(tracker.returncode, 0, out + err)
        report = json.loads(out)
        out, err = session.communicate(timeout=120)
        self.assertEqual(session.returncode, 0, out + err)
        self.assertEqual(report['with_pose_share'], 1.0, report)
        self.assertEqual(report['tracked_at'], 'client')
        self.assertGreater(report['frames_without_server'], 0)
        self.assertLess(report['frames_without_server'], report['frames'])
        self.assertGreater(report['map_age_s'], 1.0)
        # Revisions of before and after, and no others.
        seen = [int(line.split()[6]) for line in states.read_text().splitlines() if not line.startswith('#')]
        self.assertEqual(seen, sorted(seen))
        self.assertGreaterEqual(seen[0], made.json['revision'])
        self.assertGreater(seen[-1], made.json['revision'] + 10)
        self.assertEqual(self.server.stop(), 0)
        info = must('info', maps / 'office.cairn')
        self.assertLessEqual(seen[-1], info['revision'])
        # And they are right.
        self.assertLess(must('eval', 'ate', poses, self.visits[2] / 'groundtruth_cam0.txt')['ate_m'], 0.05)


if __name__ == '__main__':
    unittest.main(verbosity=2)
