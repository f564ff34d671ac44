"""What may happen to the machine that the server runs on: a disk that fills under it, a clock that jumps."""
import json
import os
import pathlib
import resource
import shutil
import struct
import subprocess
import tempfile
import time
import unittest

from cairn_cli import BINARY, cairn, must
from served_maps import Server

DAY_S = 86400


class ServerFaults(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix='cairn-e2e-'))
        cls.visit, cls.made = cls.folder / 'visit', cls.folder / 'made'
        must('synth', 'office', '--seed', 4, '--duration', 5, '--image-size', 480, 360, '--focal', 315, '--out', cls.visit)
        cls.made.mkdir()
        must('run', cls.visit, '--map', cls.made / 'good.cairn')

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    def ask(self, *arguments):
        return cairn('--server', self.server.address, *arguments)

    def assert_good(self, name):
        verified = self.ask('verify', name)
        self.assertEqual(verified.code, 0, f'{verified.out}{verified.err}')
        found = self.ask('localize', self.visit, '--independent', '--stride', 30, '--map', name)
        self.assertEqual(found.code, 0, f'{found.out}{found.err}')

    def assert_tells(self, failed, what):
        """What has not happened, of which disk, and what to do; and not where that is."""
        said = failed.out + failed.err
        self.assertEqual(failed.code, 1, said)
        for part in (what, 'disk of the server that holds the maps is full', 'makes room there', '.trash'):
            self.assertIn(part, json.loads(failed.out)['error'] if failed.out.startswith('{') else said)
        self.assertNotIn(str(self.folder), said)

    def fills_up(self, maps, fill, make_room, room_elsewhere=False):
        """A session whose map finds no room: it ends with an error that says so, and nobody else is disturbed."""
        shutil.copy(self.made / 'good.cairn', maps)
        self.server = Server(maps)
        try:
            fill(self.server)
            failed = self.ask('run', self.visit, '--map', 'large')
            self.assertEqual(failed.code, 1, failed.out)
            self.assert_tells(failed, 'map "large" is')
            self.assertIsNone(self.server.process.poll(), 'the server is alive')
            self.assert_good('good')
            copied = self.ask('snapshot', 'good', 'copy')
            self.assertEqual(copied.code, 1, 'nor is there room for a copy')
            self.assert_tells(copied, 'map "good" is not copied to "copy"')
            self.assert_tells(self.ask('create', 'empty'), 'map "empty" is not made')
            exported = self.ask('export', 'good', self.folder / 'out.cairn')
            if room_elsewhere:  # it goes by way of the folder for temporary files
                self.assertEqual(exported.code, 0, exported.out)
                (self.folder / 'out.cairn').unlink()
            else:
                self.assert_tells(exported, 'map "good" is not exported')
            status, _, text = self.server.get('/v1/maps/good:snapshot', b'{"as": "copy"}', 'application/json')
            self.assertEqual((status, json.loads(text)['error']['reason']), (507, 'disk_full'))
            # What was durable is a map, if there was anything.
            if (maps / 'large.cairn').exists():
                self.assert_good('large')
            make_room(self.server)
            self.assertEqual(self.ask('run', self.visit, '--map', 'later').code, 0)
            for name in ('good', 'later'):
                self.assert_good(name)
        finally:
            self.assertEqual(self.server.stop(), 0)
        self.assertEqual([p.name for p in maps.iterdir() if p.name.startswith('copy')], [], 'nothing is left behind')

    def test_a_file_that_may_not_become_larger(self):
        maps = pathlib.Path(tempfile.mkdtemp(prefix='maps-', dir=self.folder))
        most = (self.made / 'good.cairn').stat().st_size // 2

        def limit(bytes_):
            return lambda server: resource.prlimit(server.process.pid, resource.RLIMIT_FSIZE, (bytes_, resource.RLIM_INFINITY))
        self.fills_up(maps, limit(most), limit(resource.RLIM_INFINITY))

    def test_a_disk_that_fills(self):
        maps = pathlib.Path(tempfile.mkdtemp(prefix='disk-', dir=self.folder))
        size = 12 * (self.made / 'good.cairn').stat().st_size
        if subprocess.run(['mount', '-t', 'tmpfs', '-o', f'size={size}', 'tmpfs', maps], capture_output=True).returncode != 0:
            self.skipTest('needs the right to mount a disk')
        filler = maps / 'filler'

        def fill(_):
            free = shutil.disk_usage(maps).free
            with open(filler, 'wb') as file:
                file.truncate(0)
                os.posix_fallocate(file.fileno(), 0, free - (self.made / 'good.cairn').stat().st_size // 2)
        try:
            self.fills_up(maps, fill, lambda _: filler.unlink(), room_elsewhere=True)
        finally:
            subprocess.run(['umount', maps], check=True)

    def test_a_disk_that_takes_no_further_file(self):
        maps = pathlib.Path(tempfile.mkdtemp(prefix='disk-', dir=self.folder))
        if subprocess.run(['mount', '-t', 'tmpfs', '-o', 'size=200m,nr_inodes=40', 'tmpfs', maps], capture_output=True).returncode != 0:
            self.skipTest('needs the right to mount a disk')
        try:
            for name in ('good', 'other'):
                shutil.copy(self.made / 'good.cairn', maps / f'{name}.cairn')
            self.server = Server(maps)
            deleted = self.ask('delete', 'other').json['deleted']
            fillers = []
            with self.assertRaises(OSError):
                for number in range(100):
                    (maps / f'filler_{number}').touch()
                    fillers.append(maps / f'filler_{number}')
            self.assert_tells(self.ask('delete', 'good'), 'map "good" is not deleted')
            self.assert_tells(self.ask('restore', deleted), f'"{deleted}" stays in the trash')
            self.assertIn('takes no further file', self.ask('create', 'empty').out)
            for filler in fillers:
                filler.unlink()
            self.assertEqual(self.ask('restore', deleted).code, 0)
            self.assertEqual(self.ask('delete', 'good').code, 0)
            self.assertEqual(self.server.stop(), 0)
        finally:
            subprocess.run(['umount', maps], check=True)

    def test_a_clock_that_jumps(self):
        maps = pathlib.Path(tempfile.mkdtemp(prefix='maps-', dir=self.folder))
        shutil.copy(self.made / 'good.cairn', maps)
        clock = self.folder / 'clock'
        with open(clock, 'wb') as file:
            file.write(struct.pack('<q', 0))

        def jump_to(offset_s):
            with open(clock, 'r+b') as file:
                file.write(struct.pack('<q', offset_s))
        os.environ.update({'LD_PRELOAD': os.environ['CAIRN_JUMPING_CLOCK'], 'CAIRN_CLOCK_FILE': str(clock)})
        try:
            self.server = Server(maps)
            jumps = [DAY_S, -DAY_S, 400 * DAY_S, -3600, 0]
            live = subprocess.Popen([BINARY, '--server', self.server.address, 'run', str(self.visit), '--map', 'live', '--realtime', '0.5',
                                     '--json'], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
            deleted = []
            for offset_s in jumps:
                jump_to(offset_s)
                time.sleep(0.3)
                self.assertEqual(self.ask('ls').code, 0)
                # The trash and the history know times, and neither needs that they increase.
                self.assertEqual(self.ask('snapshot', 'good', 'copy').code, 0)
                gone = self.ask('delete', 'copy')
                self.assertEqual(gone.code, 0, gone.err)
                deleted.append(gone.out)
            out, err = live.communicate()
            self.assertEqual(live.returncode, 0, out + err)
            self.assertEqual(len(set(deleted)), len(jumps))
            done = json.loads(out)
            self.assertEqual((done['result'], done.get('frames_before_restart', 0)), ('created', 0))
            jump_to(-DAY_S)
            self.assertEqual(self.ask('run', self.visit, '--map', 'live', '--extend').code, 0, 'a change that is older than the one before')
            for name in ('good', 'live'):
                self.assert_good(name)
            self.assertEqual(self.server.stop(), 0)
        finally:
            del os.environ['LD_PRELOAD'], os.environ['CAIRN_CLOCK_FILE']


if __name__ == '__main__':
    unittest.main(verbosity=2)
