"""A small office, rendered, mapped, aligned, relocalized and evaluated through the command line, as a user would."""
import json
import pathlib
import re
import shutil
import signal
import subprocess
import tempfile
import time
import unittest

from cairn_cli import BINARY, cairn, must


class Office(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix='cairn-e2e-'))
        for visit, duration in ((1, 8), (2, 4)):
            must('synth', 'office', '--seed', 3, '--session', visit, '--duration', duration, '--effects', 'noise', '--out',
                 cls.folder / f'visit_{visit}')
        cls.first, cls.second = cls.folder / 'visit_1', cls.folder / 'visit_2'
        cls.map, cls.frames = cls.folder / 'office.cairn', cls.folder / 'frames.txt'
        cls.report = must('run', cls.first, '--map', cls.map, '--trajectory', cls.frames, '--deterministic')
        must('align', cls.map, '--groundtruth', cls.first / 'groundtruth_cam0.txt')

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    def test_every_frame_is_tracked_and_accurate(self):
        self.assertGreaterEqual(self.report['tracked_share'], 0.95)
        self.assertGreaterEqual(self.report['keyframes'], 4)
        ate = must('eval', 'ate', self.frames, self.first / 'groundtruth_cam0.txt')
        self.assertEqual(ate['associated'], self.report['frames_tracked'])
        self.assertLess(ate['ate_m'], 0.02)

    def test_the_second_visit_is_found_in_the_map(self):
        poses = self.folder / 'poses.txt'
        located = must('localize', self.second, '--stride', 4, '--map', self.map, '--independent', '--out', poses)
        self.assertGreaterEqual(located['localized_share'], 0.5)
        result = must('eval', 'localization', poses, self.second / 'groundtruth_cam0.txt')
        self.assertEqual(result['wrong'], 0)
        self.assertLess(result['error_m']['median'], 0.03)

    def test_each_image_has_its_answer_in_json(self):
        answer = must('localize', self.second, '--stride', 20, '--map', self.map, '--independent', '--verbose')
        self.assertEqual(answer['lens'], 'none')
        self.assertEqual(len(answer['images']), answer['frames'])
        self.assertEqual(sum(image['localized'] for image in answer['images']), answer['localized'])
        for image in answer['images']:
            self.assertIn('position' if image['localized'] else 'reason', image)

    def test_queries_without_any_answer_count_as_not_located(self):
        poses, queries = self.folder / 'no_poses.txt', self.folder / 'queries.txt'
        poses.write_text('# nothing was located\n')
        truth = (self.second / 'groundtruth_cam0.txt').read_text().splitlines()
        queries.write_text('\n'.join(line.split()[0] for line in truth if not line.startswith('#')) + '\n')
        result = must('eval', 'localization', poses, self.second / 'groundtruth_cam0.txt', '--queries', queries)
        self.assertGreater(result['queries'], 0)
        self.assertEqual(result['answered'], 0)
        self.assertEqual(result['within_share'], 0)

    def test_a_lens_that_is_not_as_calibrated_is_found_and_corrected(self):
        """The same recording with a calibration that believes in a distortion which is not there."""
        lines = (self.first / 'mav0' / 'cam0' / 'sensor.yaml').read_text()
        values = [float(v) for v in re.search(r'intrinsics: *\[(.*?)\]', lines).group(1).split(',')]
        size = re.search(r'resolution: *(\[.*?\])', lines).group(1)
        wrong = self.folder / 'wrong.yaml'
        wrong.write_text(f'model: radial_tangential\nresolution_px: {size}\nintrinsics_px: {values}\n'
                         'distortion: [0.04, 0, 0, 0]\n')
        found, frames, ate = {}, self.folder / 'lens.txt', {}
        for name, extra in (('corrected', []), ('fixed', ['--fixed-lens'])):
            report = must('run', self.first, '--camera', wrong, '--map', self.folder / f'{name}.cairn', '--trajectory', frames,
                          '--deterministic', '--overwrite', *extra)
            found[name] = report['lens']
            ate[name] = must('eval', 'ate', frames, self.first / 'groundtruth_cam0.txt')['ate_m']
        self.assertTrue(found['corrected']['corrected'], found)
        self.assertIsNone(found['fixed'])
        self.assertAlmostEqual(found['corrected']['focal_scale'], 1.0, delta=0.01)
        self.assertAlmostEqual(found['corrected']['k1'], -0.04, delta=0.01)
        self.assertLess(ate['corrected'], 0.015)
        self.assertLess(ate['corrected'], 0.4 * ate['fixed'])
        # Nothing but a map replaces a map.
        before = (self.folder / 'fixed.cairn').read_bytes()
        for option in ('--trajectory', '--live-poses', '--keyframes'):
            refused = cairn('run', self.first, '--map', self.folder / 'other.cairn', option, self.folder / 'fixed.cairn',
                            '--overwrite')
            self.assertEqual(refused.code, 1)
            self.assertIn('is a map', refused.out + refused.err)
        self.assertEqual((self.folder / 'fixed.cairn').read_bytes(), before)
        # A right calibration is left alone.
        self.assertFalse(self.report['lens']['corrected'], self.report['lens'])
        self.assertIsNone(must('info', self.map)['cameras'][0]['lens'])
        # The map corrects queries of the same camera likewise.
        self.assertIsNotNone(must('info', self.folder / 'corrected.cairn')['cameras'][0]['lens'])
        must('align', self.folder / 'corrected.cairn', '--groundtruth', self.first / 'groundtruth_cam0.txt')
        poses = self.folder / 'lens_poses.txt'
        query = ['localize', self.second, '--map', self.folder / 'corrected.cairn', '--independent']
        located = must(*query, '--camera', wrong, '--stride', 4, '--out', poses)
        self.assertEqual(located['lens'], 'corrected')
        # Rounding makes no other camera.
        rounded = self.folder / 'rounded.yaml'
        rounded.write_text(wrong.read_text().replace('[0.04, 0, 0, 0]', '[0.040001, 0, 0, 0]'))
        self.assertEqual(must(*query, '--camera', rounded, '--stride', 40)['lens'], 'corrected')
        # Another calibration is used as it is, and the answer says so.
        self.assertEqual(must(*query, '--stride', 40)['lens'], 'other calibration')
        result = must('eval', 'localization', poses, self.second / 'groundtruth_cam0.txt')
        self.assertEqual(result['wrong'], 0)
        self.assertLess(result['error_m']['median'], 0.03)

    def without(self, begin, end, name):
        """The first visit without some of its images."""
        folder, cam = self.folder / name, self.first / 'mav0' / 'cam0'
        (folder / 'mav0' / 'cam0').mkdir(parents=True)
        for part in ('data', 'sensor.yaml'):
            (folder / 'mav0' / 'cam0' / part).symlink_to((cam / part).resolve())
        header, *images = (cam / 'data.csv').read_text().splitlines(keepends=True)
        (folder / 'mav0' / 'cam0' / 'data.csv').write_text(header + ''.join(images[:begin] + images[end:]))
        return folder

    def test_a_gap_between_images_is_told(self):
        report = must('run', self.without(100, 130, 'gap'), '--odometry-only', '--deterministic', '--trajectory',
                      self.folder / 'gap.txt')
        self.assertEqual(report['gaps'], 1)
        self.assertAlmostEqual(report['longest_gap_s'], 31 * self.report['duration_s'] / (self.report['frames'] - 1), delta=0.01)
        self.assertEqual(must('run', self.first, '--odometry-only', '--until', 2, '--trajectory', self.folder / 'two.txt')['gaps'], 0)

    def test_parts_of_a_map_that_nothing_links_are_told_apart(self):
        # Three seconds are missing in which the camera turned away: what it sees then is linked to nothing before.
        parts_map, frames, poses = (self.folder / name for name in ('parts.cairn', 'parts.txt', 'parts_poses.txt'))
        visit, truth = self.without(50, 110, 'away'), self.first / 'groundtruth_cam0.txt'
        report = must('run', visit, '--map', parts_map, '--deterministic', '--trajectory', frames)
        self.assertEqual(report['segments'], 2)
        self.assertEqual([component['id'] for component in report['components']], [1, 2])
        largest, other = sorted(report['components'], key=lambda component: -component['frames'])
        self.assertEqual(report['component_of_files'], largest['id'])
        self.assertEqual(report['keyframes'], largest['keyframes'] + other['keyframes'])
        ate = must('eval', 'ate', frames, truth)
        self.assertEqual(ate['associated'], largest['frames'])
        self.assertLess(ate['ate_m'], 0.02)
        self.assertEqual({component['id']: component['keyframes'] for component in must('info', parts_map)['components']},
                         {component['id']: component['keyframes'] for component in (largest, other)})
        self.assertEqual(must('align', parts_map, '--component', largest['id'], '--groundtruth', truth, '--force')['component'], largest['id'])
        located = must('localize', visit, '--stride', 5, '--map', parts_map, '--independent', '--out', poses, '--verbose')
        found_in = [image['component'] for image in located['images'] if image['localized']]
        self.assertEqual(found_in.count(other['id']), located['localized_in_other_components'])
        self.assertGreaterEqual(found_in.count(other['id']), 3)
        self.assertGreaterEqual(found_in.count(largest['id']), 3)
        result = must('eval', 'localization', poses, truth)
        self.assertEqual((result['wrong'], result['answered']), (0, found_in.count(largest['id'])), result)

    def test_info_knows_the_alignment_and_the_provenance(self):
        info = must('info', self.map)
        self.assertEqual(info['keyframes'], self.report['keyframes'])
        self.assertTrue(info['components'][0]['aligned'])
        self.assertEqual([s['source'] for s in info['sessions']], ['visit_1'])
        self.assertTrue(info['sessions'][0]['complete'])

    def test_two_deterministic_runs_are_identical(self):
        again, frames = self.folder / 'again.cairn', self.folder / 'again.txt'
        must('run', self.first, '--map', again, '--trajectory', frames, '--deterministic')
        third = self.folder / 'third.cairn'
        must('run', self.first, '--map', third, '--deterministic')
        self.assertEqual(frames.read_bytes(), self.frames.read_bytes())
        self.assertEqual(must('info', again, '--digest')['digest'], must('info', third, '--digest')['digest'])
        other = self.folder / 'other_options.cairn'
        must('run', self.first, '--map', other, '--deterministic', '--fixed-lens')
        self.assertNotEqual(must('info', other)['id'], must('info', again)['id'])

    def test_the_threaded_run_is_as_good(self):
        frames = self.folder / 'threaded.txt'
        report = must('run', self.first, '--map', self.folder / 'threaded.cairn', '--trajectory', frames)
        self.assertGreaterEqual(report['tracked_share'], 0.95)
        self.assertLess(must('eval', 'ate', frames, self.first / 'groundtruth_cam0.txt')['ate_m'], 0.02)

    def test_the_odometry_alone_gives_poses_and_no_map(self):
        frames = self.folder / 'odometry.txt'
        before = set(self.folder.iterdir())
        report = must('run', self.first, '--odometry-only', '--trajectory', frames)
        self.assertEqual(set(self.folder.iterdir()) - before, {frames})
        self.assertGreaterEqual(report['tracked_share'], 0.95)
        self.assertEqual(report['segments'], 1)
        ate = must('eval', 'ate', frames, self.first / 'groundtruth_cam0.txt')
        self.assertEqual(ate['associated'], report['trajectory_frames'])
        self.assertLess(ate['ate_m'], 0.03)

    def test_a_photometric_calibration_needs_motion(self):
        out = self.folder / 'calibration'
        answer = cairn('camera', 'calibrate-photometric', self.first, '--until', 0.15, '--out', out)
        self.assertEqual(answer.code, 1)
        self.assertRegex(answer.json['error'], 'does not determine|surface points')
        self.assertFalse(out.exists())
        self.assertEqual(cairn('run', self.first, '--photometric', out, '--odometry-only').code, 1)

    def test_a_map_of_stills_with_known_poses_locates_the_second_visit(self):
        stills, poses = self.folder / 'stills.cairn', self.folder / 'stills_poses.txt'
        must('run', self.first, '--stride', 8, '--poses', self.first / 'groundtruth_cam0.txt', '--map', stills)
        must('localize', self.second, '--stride', 8, '--map', stills, '--independent', '--out', poses)
        result = must('eval', 'localization', poses, self.second / 'groundtruth_cam0.txt')
        self.assertGreater(result['answered'], 0)
        self.assertEqual(result['wrong'], 0)

    def test_pictures_are_drawn(self):
        for name, arguments in {'map.png': ('info', self.map, '--picture'),
                                'ate.svg': ('eval', 'ate', self.frames, self.first / 'groundtruth_cam0.txt', '--plot')}.items():
            must(*arguments, self.folder / name)
            start = (self.folder / name).read_bytes()[:200]
            self.assertTrue(start.startswith(b'\x89PNG') if name.endswith('png') else b'<svg' in start)

    def test_damaged_and_missing_images_are_skipped_and_counted(self):
        damaged = self.folder / 'damaged'
        shutil.copytree(self.first, damaged)
        images = sorted((damaged / 'mav0' / 'cam0' / 'data').glob('*.png'))
        images[40].unlink()
        images[60].write_bytes(images[60].read_bytes()[:500])
        report = must('run', damaged, '--map', self.folder / 'damaged.cairn')
        self.assertEqual(report['frames_skipped'], 2)
        self.assertGreaterEqual(report['tracked_share'], 0.9)

    def test_a_sequence_without_a_usable_image_is_a_failure(self):
        broken = self.folder / 'broken'
        shutil.copytree(self.first, broken)
        for image in (broken / 'mav0' / 'cam0' / 'data').glob('*.png'):
            image.write_bytes(image.read_bytes()[:500])
        for arguments in (('run', broken, '--map', self.folder / 'broken.cairn'),
                          ('localize', broken, '--map', self.map, '--independent')):
            answer = cairn(*arguments)
            self.assertEqual(answer.code, 1, answer.out + answer.err)
            self.assertIn('error', answer.json)
        self.assertFalse((self.folder / 'broken.cairn').exists())

    def test_a_killed_run_leaves_a_good_map(self):
        killed = self.folder / 'killed.cairn'
        process = subprocess.Popen([BINARY, 'run', str(self.first), '--map', str(killed), '--json'], stdout=subprocess.DEVNULL)
        deadline = time.monotonic() + 60
        while not killed.exists() and time.monotonic() < deadline and process.poll() is None:
            time.sleep(0.05)
        time.sleep(0.5)
        process.send_signal(signal.SIGKILL)
        process.wait()
        info = must('info', killed)
        self.assertGreaterEqual(info['keyframes'], 1)

    def test_damage_in_the_log_of_a_killed_run_is_told_and_nothing_does_away_with_it(self):
        work = self.folder / 'damaged_log'
        work.mkdir()
        killed, log = work / 'killed.cairn', work / 'killed.cairn-wal'
        process = subprocess.Popen([BINARY, 'run', str(self.first), '--map', str(killed), '--realtime', '1', '--json'], stdout=subprocess.DEVNULL)
        deadline = time.monotonic() + 60
        while (not log.exists() or log.stat().st_size < 600_000) and time.monotonic() < deadline and process.poll() is None:
            time.sleep(0.02)
        process.send_signal(signal.SIGKILL)
        process.wait()
        (work / 'killed.cairn-shm').unlink(missing_ok=True)
        damaged = bytearray(log.read_bytes())
        damaged[len(damaged) // 2] ^= 16
        log.write_bytes(damaged)
        before = {path.name: path.read_bytes() for path in (killed, log)}
        photo = sorted((self.first / 'mav0/cam0/data').glob('*.png'))[0]
        for arguments in (('info', killed), ('ls', killed, 'keyframes'), ('stats', killed), ('show', killed, 'session', 1), ('log', killed),
                          ('localize', photo, '--map', killed), ('export', killed, work / 'points.ply'), ('verify', killed),
                          ('snapshot', killed, work / 'copy.cairn'), ('compact', killed), ('verify', killed)):
            answer = cairn(*arguments)
            self.assertIn('cairn recover', answer.err + answer.out, arguments)
            self.assertEqual(answer.code, 3 if arguments[0] in ('verify', 'snapshot', 'compact') else 0, f'{arguments}: {answer.out}')
            self.assertEqual({path.name: path.read_bytes() for path in (killed, log)}, before, arguments)
        lost = must('info', killed)['revision']
        must('recover', killed, work / 'recovered.cairn')
        self.assertGreater(must('info', work / 'recovered.cairn')['keyframes'], 0)
        self.assertEqual({path.name: path.read_bytes() for path in (killed, log)}, before)
        self.assertGreaterEqual(must('info', work / 'recovered.cairn')['keyframes'], must('info', killed)['keyframes'], lost)

    def test_bench_tells_times_and_memory(self):
        report = must('bench', 'direct', self.first, '--preset', 'fast')
        self.assertGreaterEqual(report['frames_tracked'] / report['frames'], 0.95)
        for stage in ('pyramid', 'track', 'start', 'trace', 'activate', 'optimize', 'marginalize', 'frame'):
            self.assertGreater(report['stages_ms'][stage]['median'], 0, stage)
        self.assertGreater(report['peak_memory_mb'], 20)

    def test_an_interrupted_run_writes_what_it_has(self):
        cut, frames = self.folder / 'cut.cairn', self.folder / 'cut.txt'
        process = subprocess.Popen([BINARY, 'run', str(self.first), '--map', str(cut), '--trajectory', str(frames),
                                    '--realtime', '0.1', '--json'], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        deadline = time.monotonic() + 120
        while not cut.exists() and time.monotonic() < deadline and process.poll() is None:
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        report = json.loads(process.communicate(timeout=120)[0])
        self.assertEqual(process.returncode, 130)
        self.assertTrue(report['interrupted'])
        self.assertLess(report['frames_tracked'], report['frames'])
        poses = [line for line in frames.read_text().splitlines() if not line.startswith('#')]
        self.assertEqual(len(poses), report['frames_tracked'])
        self.assertTrue(all(s['complete'] for s in must('info', cut)['sessions']))

    def damaged_copy(self, name, at_share):
        content = bytearray(self.map.read_bytes())
        start = int(len(content) * at_share)
        content[start:start + 20000] = bytes(byte ^ 0xFF for byte in content[start:start + 20000])
        (self.folder / name).write_bytes(content)
        return self.folder / name

    def test_bad_input_has_its_exit_code_and_says_what_to_do(self):
        # The vocabulary comes first in the file, the keyframes after it.
        bad_vocabulary = self.damaged_copy('bad_vocabulary.cairn', at_share=0.2)
        bad = self.damaged_copy('bad.cairn', at_share=0.85)
        text = self.folder / 'text.cairn'
        text.write_text('not a map\n')
        for code, message, arguments in [
                (1, 'exists already', ('run', self.first, '--map', self.map)),
                (1, 'no_such_folder', ('run', self.folder / 'no_such_folder', '--map', self.folder / 'x.cairn')),
                (1, '', ('info', self.folder / 'missing.cairn')),
                (1, '', ('info', text)),
                (3, '', ('localize', self.second, '--map', bad, '--independent'))]:
            answer = cairn(*arguments)
            self.assertEqual(answer.code, code, answer.out + answer.err)
            self.assertIn(message, answer.json['error'])
        self.assertFalse((self.folder / 'x.cairn').exists())
        for damaged in (bad, bad_vocabulary):
            answer = cairn('verify', damaged)
            self.assertEqual(answer.code, 3, answer.out + answer.err)
            self.assertTrue(answer.json['findings'])
        # The vocabulary that ships with Cairn is the same.
        self.assertGreater(must('localize', self.second, '--stride', 20, '--map', bad_vocabulary, '--independent')['localized_share'], 0)

    def test_overwriting_never_destroys_an_input_or_a_file_that_is_no_map(self):
        images = self.first / 'mav0' / 'cam0'
        for output in (images / 'data.csv', sorted((images / 'data').glob('*.png'))[0]):
            before = output.read_bytes()
            for arguments in (('run', self.first, '--map', output),
                              ('run', self.first, '--odometry-only', '--trajectory', output),
                              ('localize', self.first, '--map', self.map, '--independent', '--out', output)):
                answer = cairn(*arguments, '--overwrite')
                self.assertEqual(answer.code, 1, answer.out + answer.err)
                self.assertEqual(output.read_bytes(), before)
        notes = self.folder / 'notes.txt'
        notes.write_text('mine\n')
        answer = cairn('run', self.first, '--map', notes, '--overwrite')
        self.assertIn('not a Cairn map', answer.json['error'])
        self.assertEqual(notes.read_text(), 'mine\n')
        self.assertIn('is a folder', cairn('run', self.first, '--map', self.folder, '--overwrite').json['error'])

    def test_a_map_that_is_being_written_is_not_overwritten(self):
        path = self.folder / 'contended.cairn'
        first = subprocess.Popen([BINARY, 'run', str(self.first), '--map', str(path), '--realtime', '--json'],
                                 stdout=subprocess.PIPE, text=True)
        deadline = time.monotonic() + 60
        while not path.exists() and time.monotonic() < deadline and first.poll() is None:
            time.sleep(0.05)
        second = cairn('run', self.first, '--until', 3, '--map', path, '--overwrite')
        report = first.communicate()[0]
        self.assertEqual(first.returncode, 0)
        self.assertEqual(second.code, 1)
        self.assertIn('being written', second.json['error'])
        self.assertEqual(json.loads(report)['keyframes'], must('info', path)['keyframes'])

    def test_images_of_another_place_are_not_located(self):
        elsewhere = self.folder / 'elsewhere'
        must('synth', 'office', '--seed', 99, '--duration', 1, '--out', elsewhere)
        answer = cairn('localize', elsewhere, '--stride', 5, '--map', self.map, '--independent')
        self.assertEqual(answer.code, 4)
        self.assertEqual(answer.json['localized'], 0)
        self.assertEqual(sum(answer.json['misses'].values()), answer.json['frames'])


class TumMono(unittest.TestCase):
    def test_a_photometrically_distorted_recording_is_mapped(self):
        with tempfile.TemporaryDirectory(prefix='cairn-e2e-') as name:
            folder = pathlib.Path(name)
            must('synth', 'office', '--seed', 5, '--duration', 6, '--format', 'tum_mono', '--effects',
                 'distortion,response,vignette,exposure,noise', '--out', folder / 'mono')
            report = must('run', folder / 'mono', '--map', folder / 'mono.cairn', '--trajectory', folder / 'frames.txt')
            self.assertGreaterEqual(report['tracked_share'], 0.95)
            self.assertLess(must('eval', 'ate', folder / 'frames.txt', folder / 'mono' / 'groundtruth.txt')['ate_m'], 0.03)


class CommandLine(unittest.TestCase):
    def test_every_verb_has_help_with_an_example(self):
        for verb in (['run'], ['localize'], ['info'], ['align'], ['synth'], ['eval', 'ate'], ['eval', 'rpe'], ['eval', 'loop'],
                     ['eval', 'localization'], ['vocab', 'train'], ['vocab', 'import'], ['vocab', 'info'], ['bench', 'direct']):
            answer = cairn(*verb, '--help', json_output=False)
            self.assertEqual(answer.code, 0)
            self.assertIn('Example', answer.out, verb)

    def test_usage_errors_exit_with_2(self):
        for arguments in ([], ['no_such_verb'], ['run'], ['run', 'x', '--map', 'y', '--unknown'], ['run', 'x'],
                          ['run', 'x', '--map', 'y', '--odometry-only'], ['run', 'x', '--map', 'y', '--realtime', '-1'],
                          ['run', 'x', '--map', 'y', '--realtime', '--deterministic']):
            self.assertEqual(cairn(*arguments, json_output=False).code, 2, arguments)

    def test_the_version_is_printed(self):
        self.assertRegex(cairn('--version', json_output=False).out, r'^cairn \d+\.\d+\.\d+')


if __name__ == '__main__':
    unittest.main(verbosity=2)
