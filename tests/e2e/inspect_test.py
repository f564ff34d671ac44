"""Looking inside a map: info, ls, show, stats, coverage, explain."""
import os
import pathlib
import re
import shutil
import signal
import sqlite3
import subprocess
import tempfile
import time
import unittest

from cairn_cli import BINARY, black_png, cairn, must
from served_maps import Server


class Inspection(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix='cairn-e2e-'))
        cls.office, cls.map = cls.folder / 'office', cls.folder / 'office.cairn'
        must('synth', 'office', '--seed', 3, '--duration', 6, '--out', cls.office)
        cls.report = must('run', cls.office, '--map', cls.map, '--deterministic')

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    def text(self, *arguments, code=0):
        """What a person gets: no line is wider than a terminal, no escape code is sent, twice the same."""
        answer = cairn(*arguments, json_output=False)
        self.assertEqual(answer.code, code, answer.out + answer.err)
        for line in answer.out.splitlines():
            self.assertLessEqual(len(line), max(80, len(str(self.map)) + 40), line)
        self.assertNotIn('\x1b', answer.out)
        self.assertEqual(cairn(*arguments, json_output=False).out, answer.out)
        return answer.out

    # info

    def test_info_fits_a_screen_and_its_parts_come_to_the_file(self):
        text = self.text('info', self.map)
        self.assertLessEqual(len(text.splitlines()), 24)
        info = must('info', self.map)
        self.assertEqual(info['bytes'], os.path.getsize(self.map))
        self.assertEqual(sum(part['bytes'] for part in info['sizes']), info['bytes'])
        self.assertAlmostEqual(sum(part['percent'] for part in info['sizes']), 100, delta=1)
        self.assertEqual(info['keyframes_looked_at'], info['keyframes'])
        self.assertTrue(0 < info['reprojection_median_px'] <= info['reprojection_rms_px'] < 2)

    def with_a_bad_point(self, name):
        """A copy of the map that cannot be loaded: a point does not check out."""
        damaged = self.folder / name
        shutil.copy(self.map, damaged)
        with sqlite3.connect(damaged) as database:
            database.execute('UPDATE points SET times_visible = times_visible + 1 WHERE id = (SELECT max(id) FROM points)')
        database.close()
        return damaged

    def test_info_does_not_load_the_map(self):
        damaged = self.with_a_bad_point('damaged.cairn')
        self.assertEqual(cairn('info', damaged).code, 0)
        self.assertEqual(cairn('info', damaged, '--digest').code, 3)

    def test_what_is_few_does_not_load_the_map(self):
        damaged = self.with_a_bad_point('damaged_elsewhere.cairn')
        point = must('ls', self.map, 'points', '--limit', 1)['points'][0]['id']
        for call in (['show', 'keyframe', 2], ['show', 'point', point], ['ls', '--limit', 2], ['ls', 'points', '--limit', 2]):
            answer = cairn(call[0], damaged, *call[1:])
            self.assertEqual(answer.code, 0, f'{call}: {answer.out}')
            self.assertEqual({**answer.json, 'map': ''}, {**must(call[0], self.map, *call[1:]), 'map': ''}, call)
        self.assertEqual(cairn('info', damaged, '--plan', json_output=False).code, 0)
        self.assertEqual(cairn('ls', damaged, 'sessions').code, 3)
        # A map that is not kept ready is loaded, with the same answer.
        with sqlite3.connect(damaged) as database:
            database.execute('DELETE FROM ready_pages')
        database.close()
        self.assertEqual(cairn('show', damaged, 'keyframe', 2).code, 3)

    def test_no_answer_comes_from_what_is_damaged(self):
        photo = sorted((self.office / 'mav0/cam0/data').glob('*'))[10]
        self.assertTrue(must('explain', self.map, photo)['localized'])
        # Points and what is kept ready of them; features.
        for name, statements in (('points', ['UPDATE points SET times_visible = times_visible + 1',
                                             'UPDATE ready_pages SET bytes = zeroblob(length(bytes)) WHERE id >> 32 = 2 AND id % 2 = 0']),
                                 ('features', ['UPDATE keyframe_features SET words = zeroblob(length(words))'])):
            damaged = self.folder / f'damaged_{name}.cairn'
            shutil.copy(self.map, damaged)
            with sqlite3.connect(damaged) as database:
                for statement in statements:
                    database.execute(statement)
            database.close()
            for call in (['coverage', damaged], ['explain', damaged, photo], ['localize', photo, '--map', damaged]):
                answer = cairn(*call)
                self.assertEqual(answer.code, 3, f'{call}: {answer.out}')
                self.assertIn('damaged', answer.json['error'])
            # A tracker goes on with what can be read, as a robot has to, and says so.
            for until in (0.3, 6):
                tracked = cairn('track', self.office, '--map', damaged, '--until', until)
                self.assertEqual(tracked.code, 3, tracked.out)
                self.assertIn('damaged', tracked.json['error'], tracked.out)

            # Nor is damage copied without a word.
            before, copy = damaged.read_bytes(), self.folder / f'copy_{name}.cairn'
            for call in (['snapshot', damaged, copy], ['export', damaged, copy], ['compact', damaged]):
                answer = cairn(*call)
                self.assertEqual(answer.code, 3, f'{call}: {answer.out}')
                self.assertIn('cairn recover', answer.json['error'])
                self.assertEqual([path.name for path in self.folder.glob(f'copy_{name}*')], [])
            self.assertEqual(damaged.read_bytes(), before)
            must('snapshot', damaged, copy, '--unchecked')

    # synth map

    def test_a_large_map_of_copies_is_a_good_map_in_which_the_place_is_found(self):
        info, large = must('info', self.map), self.folder / 'large.cairn'
        made = must('synth', 'map', '--like', self.map, '--keyframes', 5 * info['keyframes'] - 1, '--out', large)
        self.assertEqual((made['keyframes'], made['points']), (5 * info['keyframes'], 5 * info['points']))
        self.assertEqual(must('verify', large, '--deep')['findings'], [])
        # No settings are known of sessions that were copied: that is JSON, too.
        self.assertIsNone(must('info', large)['sessions'][0]['settings'])
        self.assertIsNone(must('show', large, 'session', 1)['settings'])
        found = must('localize', self.office, '--map', large, '--independent', '--stride', 30)
        alone = must('localize', self.office, '--map', self.map, '--independent', '--stride', 30)
        self.assertEqual(found['localized'], alone['localized'])
        # Twins are called so.
        twins = self.folder / 'twins.cairn'
        must('synth', 'map', '--like', self.map, '--keyframes', 2 * info['keyframes'], '--alike', '--flipped-bits', 0, '--out', twins)
        self.assertEqual(cairn('localize', self.office, '--map', twins, '--independent', '--stride', 30).code, 4)
        self.assertEqual(cairn('synth', 'map', '--like', self.map, '--out', large).code, 1)
        self.assertEqual(cairn('synth', '--out', self.folder / 'x').code, 2)

    def test_views_for_the_prompt_are_as_documented(self):
        script = pathlib.Path(__file__).resolve().parents[2] / 'schema/views/inspection.sql'
        before = self.map.read_bytes()
        database = sqlite3.connect(f'file:{self.map}?mode=ro', uri=True)
        database.executescript(script.read_text())
        keyframes = must('info', self.map)['keyframes']
        for view in ('keyframe_bytes', 'keyframe_links'):
            self.assertEqual(len(database.execute(f'SELECT * FROM {view}').fetchall()), keyframes)
        self.assertEqual(database.execute('SELECT sum(keyframes) FROM session_shares').fetchone(), (keyframes,))
        self.assertEqual(database.execute('SELECT count(*) FROM session_overlaps').fetchone(), (0,), 'there is one session')
        listed = {row['id']: row['covisible'] for row in must('ls', self.map, 'keyframes')['keyframes']}
        self.assertEqual(dict(database.execute('SELECT keyframe, neighbours FROM keyframe_links')), listed)
        self.assertGreater(database.execute('SELECT max(found_share) FROM point_quality').fetchone()[0], 0)
        self.assertGreater(database.execute('SELECT max(last_revision) FROM change_totals').fetchone()[0], 0)
        documented = (script.parents[2] / 'docs/map-format.md').read_text()
        for name, in database.execute("SELECT name FROM sqlite_temp_master WHERE type = 'view'"):
            self.assertIn(f'`{name}`', documented)
        database.close()
        self.assertEqual(self.map.read_bytes(), before)

    # ls

    def test_ls_tells_the_keyframes_of_a_map(self):
        listed = must('ls', self.map, 'keyframes')
        self.assertEqual(listed['total'], must('info', self.map)['keyframes'])
        self.assertEqual(len(listed['keyframes']), listed['total'])
        worst = must('ls', self.map, 'keyframes', '--sort', 'error_px', '--reverse', '--limit', 3)
        self.assertEqual(worst['total'], listed['total'])
        errors = sorted((keyframe['error_px'] for keyframe in listed['keyframes']), reverse=True)
        self.assertEqual([keyframe['error_px'] for keyframe in worst['keyframes']], errors[:3])
        self.assertIn('3 of', self.text('ls', self.map, 'keyframes', '--limit', 3))

    def test_ls_filters(self):
        points = must('ls', self.map, 'points')['points']
        few = must('ls', self.map, 'points', '--filter', 'observations<4', '--filter', 'error_px>0.5')['points']
        self.assertEqual([point['id'] for point in few],
                         [point['id'] for point in points if point['observations'] < 4 and point['error_px'] > 0.5])
        self.assertTrue(few)

    def test_every_kind_is_listed_and_fits_the_terminal(self):
        for kind in ('keyframes', 'points', 'sessions', 'components', 'cameras'):
            self.text('ls', self.map, kind, '--limit', 5)
            self.assertGreater(must('ls', self.map, kind)['total'], 0)
        self.assertIn('office', self.text('ls', self.folder))

    def test_what_ls_cannot_do_is_a_usage_error(self):
        for arguments in (['ls', self.map, 'keyframes', '--sort', 'beauty'], ['ls', self.map, 'keyframes', '--filter', 'points'],
                          ['ls', self.map, 'windows'], ['ls', self.folder, '--sort', 'error_px'], ['ls']):
            answer = cairn(*arguments)
            self.assertEqual(answer.code, 2, arguments)
            self.assertTrue(answer.json['error'])
        self.assertEqual(cairn('ls', self.folder / 'none.cairn', 'points').code, 1)

    # show

    def test_show_tells_all_of_a_keyframe_and_draws_it(self):
        keyframe = must('ls', self.map, 'keyframes')['keyframes'][3]
        picture = self.folder / 'keyframe.png'
        shown = must('show', self.map, 'keyframe', keyframe['id'], '--picture', picture)
        for name, value in keyframe.items():
            self.assertEqual(shown[name], value, name)
        self.assertEqual(sum(shown['features_per_octave']), shown['features'])
        self.assertEqual(picture.read_bytes()[:4], b'\x89PNG')
        shared = [neighbour['shared_points'] for neighbour in shown['neighbours']]
        self.assertEqual(shared, sorted(shared, reverse=True))
        self.assertIn('neighbours', self.text('show', self.map, 'keyframe', keyframe['id']))

    def test_show_tells_from_where_a_point_is_seen(self):
        point = must('ls', self.map, 'points', '--sort', 'observations', '--reverse', '--limit', 1)['points'][0]
        shown = must('show', self.map, 'point', point['id'])
        self.assertEqual(len(shown['seen_from']), point['observations'])
        mean_square = sum(sight['error_px']**2 for sight in shown['seen_from']) / len(shown['seen_from'])
        self.assertAlmostEqual(mean_square**0.5, point['error_px'], delta=1e-3)
        self.text('show', self.map, 'point', point['id'])

    def test_show_of_what_is_few(self):
        for kind in ('session', 'component', 'camera'):
            self.assertEqual(must('show', self.map, kind, 1)['id'], 1)
            self.text('show', self.map, kind, 1)
        self.assertEqual(cairn('show', self.map, 'camera', 9).code, 1)
        self.assertEqual(cairn('show', self.map, 'window', 1).code, 2)
        self.assertEqual(cairn('show', self.map, 'camera', 1, '--picture', self.folder / 'x.png').code, 2)

    # stats

    def test_stats_count_everything_once(self):
        info, stats = must('info', self.map), must('stats', self.map, '--picture', self.folder / 'stats.svg')
        self.assertEqual(stats['observations_per_point']['count'], info['points'])
        self.assertEqual(stats['points_per_keyframe']['count'], info['keyframes'])
        self.assertAlmostEqual(stats['observations_per_point']['mean'], info['observations_per_point'], places=6)
        for name, distribution in stats.items():
            if isinstance(distribution, dict) and distribution['count']:
                self.assertEqual(sum(distribution['histogram']['counts']), distribution['count'], name)
        self.assertIn('<svg', (self.folder / 'stats.svg').read_text()[:500])
        text = self.text('stats', self.map)
        self.assertIn('point_error_px', text)
        self.assertTrue(text.isascii())
        self.assertIn('#', self.text('stats', self.map, '--histogram', 'point_error_px'))
        self.assertEqual(cairn('stats', self.map, '--histogram', 'beauty').code, 2)

    # coverage

    def test_coverage_tries_every_keyframe_but_the_root(self):
        before = must('info', self.map, '--digest')['digest']
        coverage = must('coverage', self.map, '--picture', self.folder / 'coverage.png')
        self.assertEqual(coverage['views'] + coverage['not_tested'], must('info', self.map)['keyframes'])
        self.assertEqual(coverage['not_tested'], 1)
        self.assertEqual(sum(cell['views'] for cell in coverage['cells']), coverage['views'])
        found = sum(test['result'] == 'found' for test in coverage['tests'])
        self.assertAlmostEqual(coverage['share'], found / coverage['views'])
        self.assertEqual(cairn('coverage', self.map, '--fail-below', 1.0).code, 0 if coverage['share'] == 1.0 else 4)
        self.assertEqual(must('info', self.map, '--digest')['digest'], before)
        self.text('coverage', self.map)
        self.assertEqual((coverage['frame'], coverage['unit']), ('map', 'map units'))
        self.assertEqual(len(coverage['grounds']), 1)

    def test_coverage_tells_metres_and_map_units_apart(self):
        other, elsewhere = self.folder / 'other_room', self.folder / 'other_room.cairn'
        both, picture = self.folder / 'two_rooms.cairn', self.folder / 'two_rooms.svg'
        must('synth', 'office', '--seed', 21, '--duration', 4, '--out', other)
        must('run', other, '--map', elsewhere, '--deterministic')
        aligned = self.folder / 'first_room.cairn'
        shutil.copy(self.map, aligned)
        must('align', aligned, '--groundtruth', self.office / 'groundtruth_cam0.txt')
        must('merge', aligned, elsewhere, '--apart', '-o', both)
        coverage = must('coverage', both, '--picture', picture)
        world, own = coverage['grounds']
        self.assertEqual([(ground['frame'], ground['unit']) for ground in coverage['grounds']],
                         [('world', 'm'), ('map', 'map units')])
        self.assertEqual(world['views'] + own['views'], coverage['views'])
        alone = {'world': must('coverage', aligned), 'map': must('coverage', elsewhere)}
        for ground in coverage['grounds']:
            self.assertAlmostEqual(ground['cell_size'], alone[ground['frame']]['cell_size'], places=6)
        text = ' '.join(self.text('coverage', both, '--picture', picture, '--overwrite').split())
        self.assertRegex(text, r'cells of [\d.]+ m by their centres in the world')
        self.assertRegex(text, r'cells of [\d.]+ map units by their centres in the frame of component')
        self.assertRegex(text, r'component \d+, in a frame of its own, is not drawn')

    def test_coverage_of_an_aligned_map_is_in_the_world(self):
        aligned, picture = self.folder / 'aligned.cairn', self.folder / 'aligned.svg'
        shutil.copy(self.map, aligned)
        must('align', aligned, '--groundtruth', self.office / 'groundtruth_cam0.txt')
        coverage = must('coverage', aligned, '--picture', picture)
        self.assertEqual((coverage['frame'], coverage['unit']), ('world', 'm'))
        self.assertEqual((coverage['right'], coverage['ahead']), ([1, 0, 0], [0, 1, 0]))
        size = coverage['cell_size']
        for cell in coverage['cells']:
            self.assertAlmostEqual(cell['center'][0], (cell['x'] + 0.5) * size)
            self.assertAlmostEqual(cell['center'][1], (cell['y'] + 0.5) * size)
        for test in coverage['tests']:
            x, y = (int(value // size) for value in test['position'][:2])
            self.assertIn((x, y), [(cell['x'], cell['y']) for cell in coverage['cells']])
        self.assertIn('<svg', picture.read_text())
        self.assertRegex(self.text('coverage', aligned), r'cells of [\d.]+ m by their centres in the world')

    # explain

    def test_explain_of_an_image_of_the_map_and_of_another_room(self):
        image = sorted((self.office / 'mav0/cam0/data').glob('*'))[10]
        explained = must('explain', self.map, image, '--picture', self.folder / 'matches.png')
        self.assertTrue(explained['localized'])
        self.assertEqual(explained['stage'], 'done')
        self.assertGreater(explained['counts']['inliers'], 50)
        self.assertLess(explained['near_keyframes'][0]['angle_deg'], 30)
        other = self.folder / 'other'
        must('synth', 'office', '--seed', 77, '--duration', 1, '--out', other)
        elsewhere = sorted((other / 'mav0/cam0/data').glob('*'))[0]
        answer = cairn('explain', self.map, elsewhere, '--picture', self.folder / 'elsewhere.png')
        self.assertEqual(answer.code, 4, answer.out + answer.err)
        self.assertFalse(answer.json['localized'])
        self.assertTrue(answer.json['reason'])
        self.assertTrue(answer.json['advice'])
        self.text('explain', self.map, image)
        self.text('explain', self.map, elsewhere, code=4)
        self.assertEqual(cairn('explain', self.map, self.folder / 'none.png').code, 1)

    def test_an_image_that_was_compared_with_nothing_is_explained_and_drawn(self):
        black, picture = self.folder / 'black.png', self.folder / 'black_drawn.svg'
        black.write_bytes(black_png(640, 480))
        answer = cairn('explain', self.map, black, '--picture', picture)
        self.assertEqual(answer.code, 4, answer.out)
        self.assertEqual(answer.json['stage'], cairn('explain', self.map, black).json['stage'])
        self.assertIn('<svg', picture.read_text())
        self.assertIn('    the image alone: ', self.text('explain', self.map, black, '--picture', picture, '--overwrite', code=4))

    # Photos, names and messages

    def test_photos_of_the_maps_own_camera_need_no_calibration(self):
        photos = sorted((self.office / 'mav0/cam0/data').glob('*'))[10:40:10]
        one = must('localize', photos[0], '--map', self.map)
        self.assertTrue(one['localized'])
        poses, broken = self.folder / 'photos.txt', self.folder / 'broken.png'
        broken.write_bytes(b'nothing')
        several = must('localize', *photos, broken, '--map', self.map, '--out', poses)
        self.assertEqual((several['frames'], several['localized'], several['frames_skipped']), (3, 3, 1))
        self.assertEqual([image['image'] for image in several['images']], [str(photo) for photo in photos])
        self.assertEqual(several['images'][0]['position'], one['position'])
        self.assertEqual(len([line for line in poses.read_text().splitlines() if not line.startswith('#')]), 3)
        self.assertEqual(cairn('localize', photos[0], self.office, '--map', self.map).code, 2)
        must('synth', 'office', '--seed', 3, '--duration', 0.2, '--image-size', 320, 240, '--focal', 210, '--out', self.folder / 'small')
        small = sorted((self.folder / 'small/mav0/cam0/data').glob('*'))[0]
        self.assertIn('320x240', cairn('localize', small, '--map', self.map).json['error'])

    def test_names_cannot_command_the_terminal(self):
        strange = self.folder / 'st\x1b[31mrange.cairn'
        shutil.copy(self.map, strange)
        absent = self.folder / 'ab\x1b[31msent.cairn'
        for call in (['info', strange], ['stats', strange], ['ls', strange, 'sessions'], ['log', strange], ['verify', strange],
                     ['show', strange, 'session', 1], ['snapshot', strange, f'{strange}.copy.cairn'],
                     ['export', strange, self.folder / 'po\x1b[31mses.txt'], ['render', strange, '-o', self.folder / 'x\x1b[31m.svg'],
                     ['info', absent], ['prune', absent], ['lo\x1b[31mok'], ['localize', absent, '--map', strange]):
            answer = cairn(*call, json_output=False)
            self.assertNotIn('\x1b', answer.out + answer.err, call)

    def test_help_fits_a_terminal(self):
        waiting, verbs = [[]], 0
        while waiting:
            verb = waiting.pop()
            verbs += 1
            text = cairn(*verb, '--help', json_output=False).out
            inner = text.partition('Subcommands:')[2].partition('\n\n')[0]
            waiting += [[*verb, name] for name in re.findall(r'^  (\w\S*)', inner, flags=re.M)]
            for line in text.splitlines():
                self.assertLessEqual(len(line), 80, (verb, line))
        self.assertGreater(verbs, 40)
        options = cairn('prune', '--help', json_output=False).out.split('Options:')[1].split('There is no way')[0]
        self.assertLessEqual(max(map(len, options.splitlines())), 80)

    def test_mistakes_are_told_in_the_words_of_the_user(self):
        for call, said in ((['prune', self.map, '--budget-mb', -3], '--budget-mb: -3 is not larger than 0'),
                           (['prune', self.map, '--redundancy', 0], '--redundancy: 0 is what every keyframe has'),
                           (['coverage', self.map, '--cell', 'inf'], '--cell: inf is no number'),
                           (['prune', self.map, '--tests', -1], '--tests: -1 is less than 0'),
                           (['prune', self.map, '--tests', 'many'], '--tests: many is no number'),
                           (['render', self.map, '-o', 'x.png', '--width', 9], '--width: 9 is not within 200 to 5000'),
                           (['prune', self.map, '--budget-mb', 'nan'], '--budget-mb: nan is no number'),
                           (['coverage', self.map, '--cell', 'nan'], '--cell: nan is no number'),
                           (['info', self.map, '--picture', 'x.gif'], 'has to end in .png or .svg'),
                           (['explain', self.map, 'x', '--picture', 'x.gif'], 'has to end in .png or .svg'),
                           (['run', self.office, '--map', 'x.cairn', '--from', 3, '--until', 1], '--until 1 is not later'),
                           (['lok'], 'there is no verb "lok"')):
            answer = cairn(*call)
            self.assertEqual(answer.code, 2, answer.out)
            self.assertIn(said, answer.json['error'])

    # The same of a server's map

    def test_a_server_is_looked_into_as_a_file_is(self):
        maps, fetched = self.folder / 'maps', self.folder / 'fetched'
        for folder in (maps, fetched):
            folder.mkdir()
        shutil.copy(self.map, maps / 'office.cairn')
        shutil.copy(self.map, maps / 'before.cairn')
        must('align', maps / 'office.cairn', '--groundtruth', self.office / 'groundtruth_cam0.txt')
        here, before = maps / 'office.cairn', maps / 'before.cairn'
        image = sorted((self.office / 'mav0/cam0/data').glob('*'))[10]
        server = Server(maps)
        os.environ['TMPDIR'] = str(fetched)
        try:
            at = ('--server', server.address)
            for verb, options in (('show', ['keyframe', 3]), ('show', ['camera', 1]), ('stats', []), ('coverage', ['--views', 4]),
                                  ('explain', [image]), ('ls', ['points', '--limit', 3]), ('ls', [])):
                asked, looked = must(*at, verb, 'office', *options), must(verb, here, *options)
                self.assertEqual({**asked, 'map': ''}, {**looked, 'map': ''}, verb)
                self.assertEqual(asked['map'], 'office')
            self.assertEqual({**must(*at, 'diff', 'before', 'office'), 'first': '', 'second': ''},
                             {**must('diff', before, here), 'first': '', 'second': ''})
            since = must(*at, 'diff', 'office', '--since', 1)
            self.assertEqual(since['components_put'], [1])
            for verb, picture in (('show', ['keyframe', 3, '--picture']), ('stats', ['--picture']), ('render', ['-o']),
                                  ('explain', [image, '--picture']), ('info', ['--picture'])):
                drawn = [self.folder / f'{verb}_{where}.svg' for where in ('there', 'here')]
                must(*at, verb, 'office', *picture, drawn[0])
                must(verb, here, *picture, drawn[1])
                self.assertEqual(drawn[0].read_bytes(), drawn[1].read_bytes(), verb)
            told, looked = must(*at, 'info', 'office', '--plan', '--digest'), must('info', here, '--plan', '--digest')
            self.assertEqual([told[key] for key in ('plan', 'digest')], [looked[key] for key in ('plan', 'digest')])
            for verb, options in (('show', ['keyframe', 1]), ('stats', []), ('coverage', []), ('explain', [image]),
                                  ('render', ['-o', self.folder / 'x.png']), ('ls', []), ('diff', ['office'])):
                answer = cairn(*at, verb, 'nowhere', *options)
                self.assertEqual((answer.code, 'nowhere' in answer.json['error']), (1, True), verb)
            self.assertEqual(list(fetched.iterdir()), [])
            # Nor is anything left when it is interrupted.
            process = subprocess.Popen([BINARY, *at, 'coverage', 'office'], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            while process.poll() is None and not list(fetched.glob('*/*')):
                time.sleep(0.001)
            self.assertIsNone(process.poll(), 'it ended before it could be interrupted')
            process.send_signal(signal.SIGINT)
            self.assertEqual(process.wait(20), -signal.SIGINT)
            self.assertEqual(list(fetched.iterdir()), [])
        finally:
            del os.environ['TMPDIR']
            server.stop()


if __name__ == '__main__':
    unittest.main(verbosity=2)
