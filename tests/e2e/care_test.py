"""Keeping a map in order: sessions taken out, states compared, maps pruned, packed, compacted, merged, split, drawn, and
made of a COLMAP model."""
import os
import pathlib
import shutil
import sqlite3
import subprocess
import tempfile
import time
import unittest

from cairn_cli import BINARY, cairn, must
from served_maps import Server

SIZE = ['--image-size', 480, 360, '--focal', 315]


class Care(unittest.TestCase):
    """Two visits to an office in one map, and the second also in a map of its own."""

    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix='cairn-e2e-'))
        cls.visits = [cls.folder / 'first', cls.folder / 'second']
        for k, visit in enumerate(cls.visits):
            must('synth', 'office', '--seed', 3, '--session', k + 1, '--duration', 6, *SIZE, '--out', visit)
        cls.alone, cls.second, cls.both = (cls.folder / name for name in ('alone.cairn', 'second.cairn', 'both.cairn'))
        must('run', cls.visits[0], '--deterministic', '--map', cls.alone)
        must('align', cls.alone, '--groundtruth', cls.visits[0] / 'groundtruth_cam0.txt')
        must('run', cls.visits[1], '--deterministic', '--map', cls.second)
        shutil.copy(cls.alone, cls.both)
        must('run', cls.visits[1], '--deterministic', '--extend', '--map', cls.both)

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    def test_an_adjustment_in_parts_keeps_others_from_waiting_and_the_map_as_it_is(self):
        before = self.map.read_bytes()
        copy = self.work / 'copy.cairn'
        bench = must('bench', 'adjustment', self.map, '--copy', copy, '--points-per-part', 500, '--json')
        self.assertGreater(bench['points'], 1000)
        self.assertGreaterEqual(bench['parts'], bench['points'] // 500 // 2)
        self.assertGreater(bench['other_editor_ms']['max'], 0)
        self.assertLess(bench['log_mb'], 64)
        self.assertEqual(self.map.read_bytes(), before)
        self.assertEqual(sorted(self.work.iterdir()), [self.map])
        self.assertEqual(cairn('bench', 'adjustment', self.map, '--copy', self.map).code, 1)
        self.assertEqual(self.map.read_bytes(), before)

    def setUp(self):
        self.work = pathlib.Path(tempfile.mkdtemp(prefix='work-', dir=self.folder))
        self.map = self.work / 'office.cairn'
        shutil.copy(self.both, self.map)

    def assert_good(self, path):
        self.assertEqual(must('verify', '--deep', path)['findings'], [], path)

    def located(self, path, visit=1):
        """The share of a visit's images that are found, and the median error if the map is aligned."""
        poses = self.work / f'{path.stem}_{visit}.txt'
        answer = cairn('localize', self.visits[visit], '--map', path, '--independent', '--stride', 4, '--out', poses,
                       '--overwrite')
        self.assertIn(answer.code, (0, 4), answer.out + answer.err)
        return answer.json['localized_share']

    # session remove, diff

    def test_a_session_is_taken_out_and_the_rest_is_as_good(self):
        before = must('info', self.map)
        share = self.located(self.map, 0)
        removal = must('session', 'remove', self.map, 2)
        self.assertEqual(removal['revision'], before['revision'] + 1)
        after = must('info', self.map)
        sessions = {session['id']: session for session in after['sessions']}
        self.assertTrue(sessions[2]['removed'])
        self.assertEqual(after['keyframes'], before['keyframes'] - removal['keyframes_removed'])
        self.assertEqual(after['keyframes'], sessions[1]['keyframes'])
        self.assert_good(self.map)
        self.assertGreaterEqual(self.located(self.map, 0), share - 0.05)
        # The alignment holds: what is left of the first visit is where its ground truth says.
        poses = self.work / 'poses.txt'
        must('localize', self.visits[0], '--map', self.map, '--independent', '--stride', 5, '--out', poses)
        result = must('eval', 'localization', poses, self.visits[0] / 'groundtruth_cam0.txt')
        self.assertEqual(result['wrong'], 0)
        self.assertLess(result['error_m']['median'], 0.02)

        change = must('diff', self.both, self.map, '--plot', self.work / 'change.png')
        self.assertFalse(change['same'])
        self.assertEqual(change['sessions_removed'], [2])
        self.assertEqual(len(change['keyframes_removed']), removal['keyframes_removed'])
        self.assertEqual(change['keyframes_added'], [])
        self.assertLess(change['keyframe_shift_median'], 0.02)
        self.assertGreater((self.work / 'change.png').stat().st_size, 10000)
        since = must('diff', self.map, '--since', before['revision'])
        self.assertEqual(since['keyframes_removed'], change['keyframes_removed'])
        self.assertEqual((since['told_apart'], since['keyframes_added'], since['keyframes_came_and_went']), (True, [], []))

        # The visit that is gone by now came since the first: in the map as it was before, and in that of now.
        came = must('diff', self.both, '--since', must('info', self.alone)['revision'])
        grown = must('diff', self.alone, self.both)
        self.assertEqual(came['keyframes_added'], grown['keyframes_added'])
        self.assertEqual(came['keyframes_removed'], grown['keyframes_removed'])
        self.assertEqual((came['points_added'], came['points_removed']), (grown['points_added'], grown['points_removed']))
        self.assertEqual(came['sessions_added'], [2])
        gone = must('diff', self.map, '--since', must('info', self.alone)['revision'])
        self.assertEqual(gone['keyframes_added'], [])
        self.assertEqual(gone['keyframes_came_and_went'], sorted(came['keyframes_added'] + came['keyframes_came_and_went']))
        words = cairn('diff', self.map, '--since', 1, json_output=False).out
        self.assertIn('keyframes added (', words)
        self.assertIn('keyframes that came and went (', words)
        self.assertTrue(must('diff', self.map, self.map)['same'])

        self.assertEqual(cairn('session', 'remove', self.map, 2).code, 1)
        self.assertEqual(cairn('session', 'remove', self.map, 9).code, 1)
        self.assertEqual(cairn('session', 'remove', self.map).code, 2)

    def test_a_session_is_taken_out_of_a_map_of_a_server(self):
        server = Server(self.work)
        try:
            removal = must('--server', server.address, 'session', 'remove', 'office', 2)
            self.assertGreater(removal['keyframes_removed'], 3)
            self.assertEqual(must('--server', server.address, 'log', 'office')['changes'][0]['reason'], 'remove session 2')
            self.assertEqual(cairn('--server', server.address, 'session', 'remove', 'none', 2).code, 1)
        finally:
            server.stop()
        self.assert_good(self.map)

    def test_unrelated_maps_are_not_compared(self):
        answer = cairn('diff', self.alone, self.second)
        self.assertEqual(answer.code, 1)
        self.assertIn('in common', answer.json['error'])
        self.assertEqual(cairn('diff', self.alone).code, 2)
        self.assertEqual(cairn('diff', self.alone, '--since', 10 ** 6).code, 1)

    # prune, compact, pack

    def test_pruning_to_a_budget_costs_what_it_says(self):
        info = must('info', self.map)
        vocabulary = next(part['bytes'] for part in info['sizes'] if part['part'] == 'vocabulary')
        budget = (vocabulary + 0.6 * (info['bytes'] - vocabulary)) / 1e6
        digest = must('info', self.map, '--digest')['digest']
        dry = must('prune', self.map, '--budget-mb', budget, '--dry-run')
        self.assertEqual(must('info', self.map, '--digest')['digest'], digest)
        self.assertNotIn('bytes_after', dry)
        share = self.located(self.map)
        done = must('prune', self.map, '--budget-mb', budget)
        self.assertEqual(done['keyframes_removed'], dry['keyframes_removed'])
        self.assertEqual(done['bytes_after'], os.path.getsize(self.map))
        self.assertLessEqual(done['bytes_after'], 1.04 * budget * 1e6)
        self.assertAlmostEqual(done['bytes_after'], dry['bytes_predicted'], delta=0.05 * info['bytes'])
        self.assert_good(self.map)
        self.assertGreaterEqual(self.located(self.map), share - 0.1)
        answer = cairn('prune', self.map, '--budget-mb', 0.1)
        self.assertEqual(answer.code, 1)
        self.assertIn('MB', answer.json['error'])

    def test_compacting_gives_room_back(self):
        must('session', 'remove', self.map, 2)
        digest, size = must('info', self.map, '--digest')['digest'], os.path.getsize(self.map)
        compacted = must('compact', self.map)
        self.assertEqual(compacted['bytes_before'], size)
        self.assertEqual(compacted['bytes_after'], os.path.getsize(self.map))
        self.assertLess(compacted['bytes_after'], size)
        self.assertEqual(must('info', self.map, '--digest')['digest'], digest)
        self.assert_good(self.map)

    def test_a_killed_compaction_leaves_the_map_good(self):
        must('session', 'remove', self.map, 2)
        digest = must('info', self.map, '--digest')['digest']
        for delay in (0.02, 0.05, 0.1):
            process = subprocess.Popen([BINARY, 'compact', self.map], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            try:
                process.wait(timeout=delay)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            self.assertEqual(must('info', self.map, '--digest')['digest'], digest)
        self.assert_good(self.map)

    def test_a_packed_map_is_small_and_found(self):
        packed = self.work / 'packed.cairn'
        report = must('pack', self.map, '--localization-only', '-o', packed)
        self.assert_good(packed)
        self.assertLess(report['features_after'], report['features_before'])
        self.assertEqual(report['points_after'], report['points_before'])
        content = report['bytes_before'] - report['vocabulary_bytes']
        self.assertLess(report['bytes_after'] - report['vocabulary_bytes'], 0.6 * content)
        self.assertGreaterEqual(self.located(packed), self.located(self.map) - 0.05)
        self.assertEqual(cairn('pack', self.map, '--localization-only', '-o', packed).code, 1)
        self.assertEqual(cairn('pack', self.map, '--localization-only', '-o', self.map, '--overwrite').code, 1)
        self.assertEqual(cairn('pack', self.map, '-o', self.work / 'x.cairn').code, 2)

    # merge, split

    def test_two_maps_of_one_place_become_one(self):
        out = self.work / 'merged.cairn'
        merged = must('merge', self.alone, self.second, '-o', out)
        self.assertTrue(merged['overlap'])
        self.assertEqual([part['joined_into'] for part in merged['components']], [1])
        self.assert_good(out)
        info = must('info', out)
        self.assertEqual(info['keyframes'], must('info', self.alone)['keyframes'] + must('info', self.second)['keyframes'])
        self.assertEqual(len(info['cameras']), 1)
        self.assertEqual([part['join']['revision'] for part in info['components'] if part['joined_into']], [info['revision']])
        # The first one's alignment is that of all: the second visit's images are where its ground truth says.
        poses = self.work / 'poses.txt'
        must('localize', self.visits[1], '--map', out, '--independent', '--stride', 4, '--out', poses)
        result = must('eval', 'localization', poses, self.visits[1] / 'groundtruth_cam0.txt')
        self.assertEqual(result['wrong'], 0)
        self.assertLess(result['error_m']['median'], 0.03)
        self.assertGreaterEqual(self.located(out), self.located(self.alone))

    def test_maps_that_do_not_overlap_are_told_apart(self):
        elsewhere, other = self.work / 'elsewhere', self.work / 'elsewhere.cairn'
        must('synth', 'office', '--seed', 77, '--duration', 4, *SIZE, '--out', elsewhere)
        must('run', elsewhere, '--deterministic', '--map', other)
        out = self.work / 'merged.cairn'
        answer = cairn('merge', self.alone, other, '-o', out)
        self.assertEqual(answer.code, 4, answer.out + answer.err)
        self.assertFalse(out.exists())
        self.assertFalse(answer.json['overlap'])
        self.assertEqual(answer.json['components'][0]['keyframes'], must('info', other)['keyframes'])
        self.assertEqual(cairn('merge', self.alone, self.both, '-o', out).code, 1, 'copies of one map')
        self.assertTrue(must('merge', self.alone, other, '-o', out, '--apart')['merged'])
        self.assertEqual(len([c for c in must('info', out)['components'] if c['keyframes']]), 2)
        self.assert_good(out)
        parts = must('split', out, '--by', 'component', '-o', self.work / 'parts')['parts']
        self.assertEqual([part['keyframes'] for part in parts],
                         [must('info', self.alone)['keyframes'], must('info', other)['keyframes']])
        for part in parts:
            self.assert_good(part['file'])

    def test_sessions_and_areas_become_maps(self):
        parts = must('split', self.map, '--by', 'session', '-o', self.work / 'parts')['parts']
        for part in parts:
            sessions = must('ls', part['file'], 'sessions')['sessions']
            self.assertEqual([session['keyframes'] > 0 for session in sessions], [True], 'only its own')
            self.assertEqual(len(must('ls', part['file'], 'components')['components']), 1)
        self.assertEqual([part['part'] for part in parts], ['session-1', 'session-2'])
        self.assertEqual(sum(part['keyframes'] for part in parts), must('info', self.map)['keyframes'])
        for part in parts:
            self.assert_good(part['file'])
        self.assertGreater(self.located(pathlib.Path(parts[1]['file'])), 0.8)
        rows = must('ls', self.map, 'keyframes')['keyframes']
        middle = sorted(row['x'] for row in rows)[len(rows) // 2]
        parts = must('split', self.map, '--box', '-1000', '-1000', '-1000', middle, 1000, 1000, '-o', self.work / 'areas')['parts']
        self.assertEqual(sum(part['keyframes'] for part in parts), len(rows))
        for part in parts:
            self.assertGreater(part['keyframes'], 0)
            self.assert_good(part['file'])
        self.assertEqual(cairn('split', self.map, '-o', self.work / 'x').code, 2)
        swapped = cairn('split', self.map, '--box', 1, '-1000', '-1000', '-1', 1000, 1000, '-o', self.work / 'x')
        self.assertEqual(swapped.code, 2)
        self.assertIn('X0 is 1 and X1 -1', swapped.json['error'])
        self.assertFalse((self.work / 'x').exists())

    # render

    def test_pictures_of_all_kinds(self):
        for view in ('plan', 'side', 'perspective'):
            for color in ('session', 'age', 'error', 'observations'):
                for ending in ('png', 'svg'):
                    out = self.work / f'{view}_{color}.{ending}'
                    picture = must('render', self.map, '-o', out, '--view', view, '--color', color)
                    self.assertEqual(picture['unit'], 'm')
                    self.assertGreater(out.stat().st_size, 20000)
        self.assertEqual(cairn('render', self.map, '-o', out).code, 1, 'it is there')
        self.assertEqual(cairn('render', self.map, '-o', self.work / 'x.jpg').code, 2)
        self.assertEqual(cairn('render', self.map, '-o', self.work / 'x.png', '--view', 'top').code, 2)
        plan = cairn('info', self.map, '--plan', json_output=False).out
        self.assertTrue(any(0x2801 <= ord(letter) <= 0x28ff for letter in plan))
        for line in plan.splitlines():
            self.assertLessEqual(len(line), 80)

    # import

    def test_a_model_comes_back_as_a_map(self):
        model, again = self.work / 'model', self.work / 'again.cairn'
        must('export', self.alone, model, '--format', 'colmap', '--images', self.visits[0])
        imported = must('import', 'colmap', model, '--images', model / 'images', '-o', again, '--metric')
        self.assertEqual(imported['images'], must('info', self.alone)['keyframes'])
        self.assertEqual(imported['images_skipped'], 0)
        self.assertLess(imported['median_pose_change'], 0.001)
        self.assert_good(again)
        poses = self.work / 'poses.txt'
        must('localize', self.visits[0], '--map', again, '--independent', '--stride', 4, '--out', poses)
        result = must('eval', 'localization', poses, self.visits[0] / 'groundtruth_cam0.txt')
        self.assertEqual(result['wrong'], 0)
        self.assertLess(result['error_m']['median'], 0.02)
        self.assertGreaterEqual(self.located(again, 0), self.located(self.alone, 0) - 0.05)
        self.assertEqual(cairn('import', 'colmap', self.work, '--images', self.work, '-o', self.work / 'x.cairn').code, 1)
        self.assertFalse((self.work / 'x.cairn').exists())

    # All of them

    def test_a_full_disk_leaves_nothing_half_written(self):
        parts = {path.name: path.stat().st_size for path in self.split_into(self.work / 'whole')}
        model = self.work / 'model'
        must('export', self.alone, model, '--format', 'colmap', '--images', self.visits[0])
        before = self.map.read_bytes()
        self.assertEqual(len(parts), 2)
        # Files end between the smaller and the larger part, as on a disk that is full: one is written, not both.
        calls = [(['split', self.map, '--by', 'session', '-o', self.work / 'parts'], sum(parts.values()) // 2)]
        out = self.work / 'out.cairn'
        for call in (['pack', self.map, '--localization-only', '--tests', 0], ['merge', self.alone, self.second],
                     ['import', 'colmap', model, '--images', model / 'images']):
            calls.append(([*call, '-o', out], 400_000))
        for call, most in calls:
            answer = cairn(*call, most_bytes=most)
            self.assertEqual(answer.code, 1, f'{call}: {answer.out}{answer.err}')
            self.assertTrue(answer.json['error'])
            self.assertEqual([path.name for path in self.work.glob('out.cairn*')], [], call)
            self.assertFalse((self.work / 'parts').exists(), call)
            self.assertNotIn('last revision', answer.json['error'], call)
            self.assertEqual(self.map.read_bytes(), before, call)
        deep = self.work / 'a' / 'b'
        answer = cairn('export', self.map, deep, '--format', 'colmap', most_bytes=20_000)
        self.assertEqual(answer.code, 1, answer.out)
        self.assertFalse(deep.parent.exists())
        # What was to be replaced is what it was.
        shutil.copy(self.alone, out)
        digest = must('info', out, '--digest')['digest']
        for call, most in calls[1:]:
            self.assertEqual(cairn(*call, '--overwrite', most_bytes=most).code, 1)
            self.assertEqual(must('info', out, '--digest')['digest'], digest)
        # What changes a map makes the change or not.
        for call in (['compact', self.map], ['session', 'remove', self.map, 2], ['prune', self.map, '--tests', 0]):
            self.assertEqual(cairn(*call, most_bytes=100_000).code, 1, call)
            self.assert_good(self.map)

    def split_into(self, folder):
        return [pathlib.Path(part['file']) for part in must('split', self.map, '--by', 'session', '-o', folder)['parts']]

    def test_a_lost_row_is_missed_and_nothing_is_built_on_what_is_left(self):
        for where in ('reported_trajectories', 'touched WHERE revision = 3', 'changes WHERE revision = 3'):
            table = where.split()[0]
            shutil.copy(self.both, self.map)
            database = sqlite3.connect(self.map)
            self.assertGreater(database.execute(f'DELETE FROM {where}').rowcount, 0, table)
            database.commit()
            database.close()
            calls = [['verify', self.map], ['prune', self.map], ['session', 'remove', self.map, 2], ['compact', self.map],
                     ['snapshot', self.map, self.work / 'copy.cairn']]
            calls += [['diff', self.map, '--since', 2]] if table == 'touched' else []
            calls += [['info', self.map], ['localize', self.visits[1], '--independent', '--map', self.map]] if table.startswith('reported') else []
            before = self.map.read_bytes()
            for call in calls:
                answer = cairn(*call)
                self.assertEqual(answer.code, 3, (table, call, answer.out))
                self.assertIn(table, answer.out)
                self.assertIn('rows instead of', answer.out)
            self.assertEqual(self.map.read_bytes(), before, table)
            saved = must('recover', self.map, self.work / f'{table}.cairn')
            lost = [note for note in saved['notes'] if 'rows are lost' in note]
            self.assertEqual([note.split()[2] for note in lost], [] if table == 'touched' else [table])

    def test_copies_of_a_killed_pruning_go_with_the_next(self):
        dead = subprocess.Popen(['true'])
        dead.wait()
        left = [self.work / f'.office-trial-{dead.pid}.cairn{end}' for end in ('', '-wal', '-shm', '-lock')]
        other = [self.work / f'.office-trial-{os.getpid()}.cairn', self.work / f'.officer-trial-{dead.pid}.cairn']
        for file in left + other:
            file.write_bytes(b'x')
        must('prune', self.map, '--budget-mb', 1000, '--tests', 0, '--dry-run')
        self.assertEqual([file.exists() for file in left + other], [False] * 4 + [True] * 2)

    def test_damaged_maps_and_writers_are_told(self):
        damaged = self.work / 'damaged.cairn'
        content = bytearray(self.map.read_bytes())
        for at in range(len(content) // 2, len(content), 5000):
            content[at] ^= 0x55
        damaged.write_bytes(content)
        out = self.work / 'out.cairn'
        for call in (['session', 'remove', damaged, 1], ['diff', self.map, damaged], ['prune', damaged],
                     ['pack', damaged, '--localization-only', '-o', out], ['merge', self.alone, damaged, '-o', out],
                     ['split', damaged, '--by', 'session', '-o', self.work / 'parts'], ['render', damaged, '-o', self.work / 'x.png']):
            answer = cairn(*call)
            self.assertEqual(answer.code, 3, f'{call}: {answer.out}{answer.err}')
            self.assertFalse(out.exists())
        # A writer at work keeps its map; whoever only reads it does.
        writer = subprocess.Popen([BINARY, 'run', self.visits[1], '--map', self.map, '--extend', '--realtime'],
                                  stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            deadline = time.monotonic() + 20
            while not pathlib.Path(f'{self.map}-wal').exists() and time.monotonic() < deadline and writer.poll() is None:
                time.sleep(0.01)
            for call in (['session', 'remove', self.map, 1], ['prune', self.map, '--tests', 0], ['compact', self.map]):
                answer = cairn(*call)
                self.assertEqual(answer.code, 1, f'{call}: {answer.out}')
                self.assertIn('writ', answer.json['error'])
            must('pack', self.map, '--localization-only', '-o', out, '--tests', 0)
            must('render', self.map, '-o', self.work / 'x.png')
        finally:
            writer.terminate()
            writer.wait(timeout=60)
        self.assert_good(out)


if __name__ == '__main__':
    unittest.main()
