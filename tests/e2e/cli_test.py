"""The command line under bad conditions: signals, full disks, outputs onto inputs, memory that runs out, what is no file."""
import fcntl
import json
import os
import pathlib
import pty
import resource
import shutil
import signal
import struct
import subprocess
import tempfile
import termios
import time
import unittest

from cairn_cli import BINARY, black_png, cairn, must


def limited(megabytes):
    """Address space of the process that is to be started."""
    return lambda: resource.setrlimit(resource.RLIMIT_AS, (megabytes << 20, megabytes << 20))


class CommandLine(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix='cairn-e2e-'))
        cls.office, cls.map, cls.frames = cls.folder / 'office', cls.folder / 'office.cairn', cls.folder / 'frames.txt'
        must('synth', 'office', '--seed', 3, '--duration', 5, '--out', cls.office)
        cls.truth = cls.office / 'groundtruth_cam0.txt'
        cls.report = must('run', cls.office, '--map', cls.map, '--trajectory', cls.frames)

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    def path(self, name):
        return self.folder / name

    def start(self, *arguments, **options):
        options = {'stdout': subprocess.PIPE, 'stderr': subprocess.PIPE, 'text': True, **options}
        return subprocess.Popen([BINARY, *map(str, arguments)], **options)

    def end_with(self, number, *arguments, until):
        """The exit code and answer of a verb that gets a signal once `until` is true."""
        process = self.start(*arguments, '--json')
        deadline = time.monotonic() + 60
        while not until() and time.monotonic() < deadline and process.poll() is None:
            time.sleep(0.05)
        process.send_signal(number)
        out, _ = process.communicate(timeout=120)
        return process.returncode, out

    # Signals

    def test_the_end_of_the_terminal_ends_a_run_in_order(self):
        for number in (signal.SIGHUP, signal.SIGTERM):
            name = self.path(f'signal_{number}')
            code, out = self.end_with(number, 'run', self.office, '--realtime', 0.5, '--map', f'{name}.cairn', '--trajectory',
                                      f'{name}.txt', until=pathlib.Path(f'{name}.cairn').exists)
            self.assertEqual(code, 128 + number)
            self.assertTrue(json.loads(out)['interrupted'])
            self.assertTrue(pathlib.Path(f'{name}.txt').exists())
            self.assertTrue(must('info', f'{name}.cairn')['sessions'][0]['complete'])

    def test_nohup_is_honoured(self):
        process = self.start('run', self.office, '--until', 3, '--odometry-only', '--realtime', '--json',
                             preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN))
        time.sleep(1.0)
        process.send_signal(signal.SIGHUP)
        out, _ = process.communicate(timeout=60)
        self.assertEqual(process.returncode, 0)
        self.assertFalse(json.loads(out)['interrupted'])

    def test_an_interrupted_localize_writes_what_it_has(self):
        poses = self.path('interrupted.txt')
        process = self.start('localize', self.office, '--map', self.map, '--independent', '--verbose', '--out', poses)
        process.stdout.readline()  # the first answer
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=60)
        self.assertEqual(process.returncode, 130)
        self.assertIn('interrupted', out)
        self.assertGreaterEqual(len(poses.read_text().splitlines()), 3)

    # Outputs that cannot be written

    def test_an_answer_that_cannot_be_written_is_a_failure(self):
        for arguments in (['vocab', 'info', '--json'], ['info', self.map], ['--help'], ['eval', 'ate', self.frames, self.truth]):
            with open('/dev/full', 'w') as full:
                process = self.start(*arguments, stdout=full)
                _, err = process.communicate(timeout=60)
            self.assertEqual(process.returncode, 1, arguments)
            self.assertIn('could not be written to standard output', err)

    def test_a_closed_output_is_a_failure_and_nothing_else_is_written_there(self):
        trajectory = self.path('closed.txt')
        process = self.start('run', self.office, '--until', 2, '--odometry-only', '--trajectory', trajectory, stdout=None,
                             preexec_fn=lambda: os.close(1))
        _, err = process.communicate(timeout=60)
        self.assertEqual(process.returncode, 1)
        self.assertIn('could not be written', err)
        self.assertTrue(trajectory.read_text().startswith('# t tx ty tz'))

    def test_a_reader_that_goes_away_is_no_noise(self):
        process = self.start('info', self.map)
        process.stdout.close()
        self.assertEqual(process.stderr.read(), '')
        process.stderr.close()
        self.assertEqual(process.wait(timeout=60), -signal.SIGPIPE)

    def test_a_full_disk_keeps_the_trajectory_that_goes_elsewhere(self):
        # The limit of a file's size stands for the disk: the map comes to it, the trajectory does not.
        trajectory = self.path('full.txt')
        limit = lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (4_600_000, 4_600_000))
        process = self.start('run', self.office, '--map', self.path('full.cairn'), '--trajectory', trajectory, '--json',
                             preexec_fn=limit)
        out, err = process.communicate(timeout=120)
        self.assertEqual(process.returncode, 1, out + err)
        self.assertIn('what was known until then is in', json.loads(out)['error'])
        self.assertGreater(len(trajectory.read_text().splitlines()), 20)
        self.assertGreaterEqual(must('info', self.path('full.cairn'))['keyframes'], 1)

    # Outputs onto inputs

    def test_no_output_replaces_an_input(self):
        plot = self.path('plot.png')
        shutil.copy(self.frames, plot)
        link, other_name = self.path('link.png'), self.path('other_name.png')
        link.symlink_to(plot)
        os.link(plot, other_name)
        before = plot.read_bytes()
        relative = pathlib.Path(os.path.relpath(plot))
        for output in (plot, link, other_name, relative, plot.parent / '.' / plot.name):
            for arguments in (['eval', 'ate', plot, self.truth, '--plot', output],
                              ['eval', 'ate', self.frames, plot, '--plot', output],
                              ['run', self.office, '--poses', plot, '--map', self.path('x.cairn'), '--picture', output],
                              ['run', self.office, '--odometry-only', '--camera', plot, '--trajectory', output],
                              ['localize', self.office, '--independent', '--camera', plot, '--map', self.map, '--picture', output],
                              ['vocab', 'import', plot, '--out', output]):
                answer = cairn(*arguments, '--overwrite')
                self.assertEqual(answer.code, 1, arguments)
                self.assertRegex(answer.json['error'], 'is named twice, or is an input|give the folder', arguments)
                self.assertEqual(plot.read_bytes(), before, arguments)
        answer = cairn('run', self.office, '--map', self.path('new.cairn'), '--trajectory', self.path('new.cairn-wal'))
        self.assertIn('belongs to a map', answer.json['error'])
        # A pipe has no name of its own; what is wrong with it is told, not what is not.
        reader, writer = os.pipe()
        os.write(writer, b'model: pinhole')
        os.close(writer)
        done = subprocess.run([BINARY, 'run', self.office, '--map', self.path('piped.cairn'), '--camera', f'/dev/fd/{reader}'],
                              capture_output=True, text=True, timeout=60, pass_fds=[reader])
        os.close(reader)
        self.assertEqual(done.returncode, 1)
        self.assertIn(f'/dev/fd/{reader} is a pipe, not a file', done.stderr)
        image = sorted((self.office / 'mav0' / 'cam0' / 'data').glob('*.png'))[0]
        hard = self.path('hard.txt')
        os.link(image, hard)
        answer = cairn('run', self.office, '--odometry-only', '--trajectory', hard, '--overwrite')
        self.assertIn('part of the sequence', answer.json['error'])

    def test_links_are_written_through(self):
        target, link = self.path('target.txt'), self.path('link.txt')
        link.symlink_to(target)
        must('run', self.office, '--until', 2, '--odometry-only', '--trajectory', link)
        self.assertTrue(link.is_symlink())
        self.assertGreater(len(target.read_text().splitlines()), 3)

    # Memory and threads

    def test_memory_that_runs_out_is_an_error(self):
        codes = set()
        for megabytes in (150, 200, 250, 300, 350, 400, 500, 600, 800):
            out = self.path(f'memory_{megabytes}.txt')
            process = self.start('run', self.office, '--map', self.path(f'memory_{megabytes}.cairn'), '--trajectory', out, '--json',
                                 preexec_fn=limited(megabytes))
            answer, err = process.communicate(timeout=120)
            if process.returncode == 127:  # not even the libraries could be loaded
                continue
            codes.add(process.returncode)
            self.assertIn(process.returncode, (0, 1), f'{megabytes} MB: {answer}{err}')
            if process.returncode == 1:
                self.assertRegex(answer + err, 'memory|thread', f'{megabytes} MB')
            self.assertNotIn('terminate', err)
            if self.path(f'memory_{megabytes}.cairn').exists():
                must('info', self.path(f'memory_{megabytes}.cairn'))
        self.assertIn(1, codes)

    # What is no file

    def test_what_is_no_file_is_an_error_that_says_so(self):
        pipe, folder = self.path('pipe'), self.path('a_folder')
        os.mkfifo(pipe)
        folder.mkdir()
        image = sorted((self.office / 'mav0' / 'cam0' / 'data').glob('*.png'))[0]
        x = self.path('x.cairn')
        for bad, kind in ((pipe, 'is a pipe'), (folder, 'is a folder'), ('/dev/zero', 'is a device')):
            for arguments in (['run', self.office, '--map', x, '--camera', bad],
                              ['run', self.office, '--map', x, '--vocabulary', bad],
                              ['run', self.office, '--map', x, '--poses', bad],
                              ['run', self.office, '--odometry-only', '--trajectory', bad, '--overwrite'],
                              ['localize', image, '--map', self.map, '--camera', bad],
                              ['eval', 'ate', self.frames, bad], ['eval', 'rpe', bad, self.truth],
                              ['eval', 'localization', self.frames, self.truth, '--queries', bad],
                              ['vocab', 'info', bad], ['vocab', 'import', bad, '--out', self.path('x.voc')]):
                process = self.start(*arguments, '--json', preexec_fn=limited(4000))
                out, err = process.communicate(timeout=30)
                self.assertEqual(process.returncode, 1, f'{arguments}: {out}{err}')
                self.assertIn(kind, json.loads(out)['error'], arguments)
        for bad in (pipe, '/dev/zero'):
            for arguments in (['run', bad, '--map', x], ['localize', bad, '--map', self.map], ['bench', 'direct', bad]):
                answer = cairn(*arguments)
                self.assertEqual(answer.code, 1, arguments)
                self.assertRegex(answer.json['error'], 'is a pipe|is a device', arguments)
        self.assertFalse(x.exists())

    def test_a_camera_is_not_larger_than_any(self):
        huge = self.path('huge.yaml')
        huge.write_text('model: pinhole\nresolution_px: [32767, 32767]\nintrinsics_px: [9000, 9000, 16000, 16000]\n')
        answer = cairn('localize', sorted((self.office / 'mav0' / 'cam0' / 'data').glob('*.png'))[0], '--map', self.map,
                       '--camera', huge)
        self.assertEqual(answer.code, 1)
        self.assertIn('megapixels', answer.json['error'])

    # Poses that are not those of the images

    def test_inverted_and_shuffled_poses_are_refused(self):
        rows = [line.split() for line in self.truth.read_text().splitlines() if not line.startswith('#')]

        def rotate(q, v):
            x, y, z, w = q
            t = [2 * (y * v[2] - z * v[1]), 2 * (z * v[0] - x * v[2]), 2 * (x * v[1] - y * v[0])]
            return [v[0] + w * t[0] + y * t[2] - z * t[1], v[1] + w * t[1] + z * t[0] - x * t[2],
                    v[2] + w * t[2] + x * t[1] - y * t[0]]

        def inverse(row):
            values = [float(value) for value in row[1:8]]
            q = [-values[3], -values[4], -values[5], values[6]]
            return [row[0]] + [str(value) for value in [-v for v in rotate(q, values[:3])] + q]

        def write(name, lines):
            self.path(name).write_text('\n'.join(' '.join(line) for line in lines) + '\n')
            return self.path(name)

        shuffled = [[row[0]] + rows[i * 37 % len(rows)][1:] for i, row in enumerate(rows)]
        self.assertNotEqual(len(rows) % 37, 0)
        arguments = ['run', self.office, '--stride', 5, '--map', self.path('stills.cairn'), '--overwrite', '--poses']
        right = must(*arguments, write('right.txt', rows))
        self.assertGreater(right['poses_fit_share'], 0.6)
        self.assertEqual((right['frame'], right['unit']), ('world', 'm'))
        inverted = cairn(*arguments, write('inverted.txt', [inverse(row) for row in rows]))
        self.assertEqual(inverted.code, 1, inverted.out)
        self.assertIn('camera_from_world', inverted.json['error'])
        self.assertEqual(cairn(*arguments, write('shuffled.txt', shuffled)).code, 1)

    # JSON says where

    def test_positions_say_their_frame_and_unit(self):
        image = sorted((self.office / 'mav0' / 'cam0' / 'data').glob('*.png'))[60]
        aligned = self.path('aligned.cairn')
        shutil.copy(self.map, aligned)
        must('align', aligned, '--groundtruth', self.truth)
        camera = self.path('camera.yaml')
        sensor = (self.office / 'mav0' / 'cam0' / 'sensor.yaml').read_text()
        value = lambda key: sensor.split(f'{key}: ')[1].splitlines()[0]
        camera.write_text(f'model: pinhole\nresolution_px: {value("resolution")}\nintrinsics_px: {value("intrinsics")}\n')
        for path, frame, unit in ((self.map, 'map', 'map units'), (aligned, 'world', 'm')):
            answer = must('localize', image, '--camera', camera, '--map', path)
            self.assertEqual((answer['frame'], answer['unit']), (frame, unit))
            answers = must('localize', self.office, '--stride', 50, '--independent', '--verbose', '--map', path)
            for answer in [answers, *(image for image in answers['images'] if image['localized'])]:
                self.assertEqual((answer['frame'], answer['unit']), (frame, unit))
        self.assertEqual((self.report['frame'], self.report['unit']), ('map', 'map units'))
        self.assertEqual(must('info', aligned)['components'][0]['world_from_component']['unit'], 'm')
        for verb in ('ate', 'rpe'):
            self.assertEqual(must('eval', verb, self.frames, self.truth)['unit'], 'm')

    # Usage and progress

    def test_an_unknown_verb_is_named_and_usage_errors_are_json_if_asked_for(self):
        for arguments, named in ((['localise', 'x'], '"localise"'), (['eval', 'foo'], '"foo" of cairn eval')):
            answer = cairn(*arguments, json_output=False)
            self.assertEqual(answer.code, 2)
            self.assertIn('there is no verb ' + named, answer.err)
            self.assertIn('there is no verb ' + named, cairn(*arguments).json['error'])
        # Options of cairn itself stand in front of the verb.
        at = ['--server', 'localhost:1']
        for arguments, says in (([*at, 'localise', 'x'], 'there is no verb "localise"'),
                                (['--server=localhost:1', 'eval', 'foo'], 'there is no verb "foo" of cairn eval'),
                                ([*at, 'recover', 'office'], 'cairn recover: it works on files: not with --server'),
                                ([*at, 'log', 'office', '--count', '0'], 'see cairn log --help')):
            answer = cairn(*arguments, json_output=False)
            self.assertEqual(answer.code, 2)
            self.assertIn(says, answer.err)
        for arguments in ([], ['run'], ['run', 'x', '--map', 'y', '--unknown'], ['localize', self.office, '--map', self.map]):
            answer = cairn(*arguments)
            self.assertEqual((answer.code, answer.json['exit_code'], answer.json['fault']), (2, 2, 'usage'), arguments)

    def test_an_empty_value_takes_nothing_that_follows(self):
        answer = cairn('run', self.office, '--map=', '--extend')
        self.assertEqual(answer.code, 2)
        self.assertIn('--map has no value', answer.json['error'])
        self.assertFalse(pathlib.Path('--extend').exists())

    def test_errors_name_the_verb_and_their_kind(self):
        for arguments, verb in ((['run'], 'cairn run: '), (['eval', 'ate'], 'cairn eval ate: '), ([], 'cairn: ')):
            answer = cairn(*arguments, json_output=False)
            self.assertEqual(answer.code, 2)
            self.assertTrue(answer.err.startswith(verb), answer.err)
            self.assertIn('--help', answer.err)
        for arguments, fault in ((['run', self.path('none'), '--map', self.path('x.cairn')], 'not_found'),
                                 (['run', self.office, '--map', self.map], 'already_exists'),
                                 (['localize', self.office, '--independent', '--map', self.office / 'groundtruth_cam0.txt'],
                                  'not_a_map')):
            answer = cairn(*arguments)
            self.assertEqual((answer.code, answer.json['fault']), (1, fault), answer.out)

    def test_a_killed_session_is_cut_off_and_lasted_as_long_as_its_keyframes_say(self):
        map = self.path('killed.cairn')
        process = self.start('run', self.office, '--map', map, '--realtime', 0.5)
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline:
            time.sleep(0.2)
            info = cairn('info', map) if map.exists() else None
            if info and info.code == 0 and info.json['keyframes'] >= 4:
                break
        self.assertFalse(info.json['sessions'][0]['cut_off'], info.out)
        process.kill()
        process.communicate()
        session = must('info', map)['sessions'][0]
        self.assertTrue(session['cut_off'], session)
        self.assertFalse(session['complete'])
        self.assertGreater(session['duration_s'], 0.2)
        self.assertIn('cut off before its end', cairn('info', map, json_output=False).out)

    def test_a_refused_alignment_ends_its_sentences_once(self):
        wrong = self.path('wrong.txt')
        rows = [line.split() for line in self.truth.read_text().splitlines() if not line.startswith('#')]
        wrong.write_text(''.join(' '.join([row[0]] + rows[i * 37 % len(rows)][1:]) + '\n' for i, row in enumerate(rows)))
        answer = cairn('align', self.map, '--groundtruth', wrong)
        self.assertEqual(answer.code, 1, answer.out)
        self.assertNotRegex(answer.json['error'], r'\.\.|\?\.')

    def test_lines_fit_a_terminal_and_stay_whole_in_a_pipe(self):
        other = self.path('damaged.cairn')
        shutil.copy(self.map, other)
        import sqlite3
        with sqlite3.connect(other) as database:
            database.execute('UPDATE keyframes SET time_ns = time_ns + 1')
        database.close()
        self.path('black.png').write_bytes(black_png(640, 480))
        for arguments in (['verify', '--deep', self.map.name], ['verify', other.name],
                          ['prune', self.map.name, '--budget-mb', 0.1],
                          ['align', self.map.name], ['localize', 'black.png', '--map', self.map.name]):
            piped = subprocess.run([BINARY, *map(str, arguments)], capture_output=True, text=True, cwd=self.folder, timeout=60)
            leader, follower = pty.openpty()
            process = subprocess.Popen([BINARY, *map(str, arguments)], stdout=follower, stderr=follower, cwd=self.folder)
            os.close(follower)
            drawn = b''
            try:
                while part := os.read(leader, 65536):
                    drawn += part
            except OSError:  # the other end is closed
                pass
            process.wait(timeout=60)
            os.close(leader)
            lines = drawn.decode().splitlines()
            self.assertLessEqual(max(map(len, lines)), 80, lines)
            self.assertEqual(' '.join(drawn.decode().split()), ' '.join((piped.stdout + piped.stderr).split()))
            self.assertGreater(max(map(len, (piped.stdout + piped.stderr).splitlines())), 80, arguments)

    def test_the_progress_never_wraps(self):
        for columns in (20, 30, 80, 100, 160):
            leader, follower = pty.openpty()
            fcntl.ioctl(follower, termios.TIOCSWINSZ, struct.pack('HHHH', 24, columns, 0, 0))
            process = self.start('run', self.office, '--until', 4, '--odometry-only', '--realtime', stderr=follower)
            os.close(follower)
            drawn = b''
            while True:
                try:
                    part = os.read(leader, 65536)
                except OSError:  # the other end is closed
                    break
                if not part:
                    break
                drawn += part
            process.communicate(timeout=60)
            os.close(leader)
            self.assertEqual(process.returncode, 0)
            lines = [line.replace('\x1b[K', '') for line in drawn.decode().replace('\n', '\r').split('\r')]
            self.assertGreater(len(lines), 5)
            self.assertLess(max(map(len, lines)), columns)
            if columns >= 80:
                self.assertTrue(any('left' in line for line in lines), lines)
            if columns == 160:
                self.assertTrue(any('█' in line for line in lines), lines)


if __name__ == '__main__':
    unittest.main(verbosity=2)
