"""Maps in which nothing is yet, or no longer: every verb says so, and none prints nothing as numbers."""
import pathlib
import re
import shutil
import tempfile
import unittest

from cairn_cli import cairn, must

SIZE = ['--image-size', 320, 240, '--focal', 210]


class EmptyMaps(unittest.TestCase):
    """One that has only been made, and one whose only session was taken out again."""

    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix='cairn-e2e-'))
        cls.office, cls.whole = cls.folder / 'office', cls.folder / 'whole.cairn'
        must('synth', 'office', '--seed', 3, '--duration', 4, *SIZE, '--out', cls.office)
        must('run', cls.office, '--deterministic', '--map', cls.whole)
        cls.new, cls.emptied = cls.folder / 'new.cairn', cls.folder / 'emptied.cairn'
        must('create', cls.new)
        shutil.copy(cls.whole, cls.emptied)
        must('session', 'remove', cls.emptied, 1)
        cls.image = sorted((cls.office / 'mav0/cam0/data').glob('*'))[5]

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    def setUp(self):
        self.work = pathlib.Path(tempfile.mkdtemp(prefix='work-', dir=self.folder))

    def test_what_needs_keyframes_names_the_map_that_has_none(self):
        for path in (self.new, self.emptied):
            for call in (['pack', path, '--localization-only', '-o', self.work / 'x.cairn'], ['render', path, '-o', self.work / 'x.png'],
                         ['split', path, '--by', 'component', '-o', self.work / 'x'], ['split', path, '--box', 0, 0, 0, 1, 1, 1, '-o', self.work / 'x'],
                         ['merge', path, self.whole, '-o', self.work / 'x.cairn'], ['merge', self.whole, path, '-o', self.work / 'x.cairn'],
                         ['align', path, '--groundtruth', self.office / 'groundtruth_cam0.txt'],
                         *(['export', path, self.work / f'x.{ending}'] for ending in ('ply', 'txt', 'csv', 'json', 'g2o'))):
                answer = cairn(*call)
                self.assertEqual(answer.code, 1, f'{call}: {answer.out}')
                self.assertIn(path.name, answer.json['error'], call)
                self.assertRegex(answer.json['error'], 'has no keyframes', call)
                self.assertEqual(list(self.work.iterdir()), [], call)

    def test_nothing_is_not_told_in_numbers(self):
        for path in (self.new, self.emptied):
            info = cairn('info', path, json_output=False).out
            self.assertIn('no keyframes', info)
            self.assertNotIn('px RMS', info)
            self.assertNotIn('covisible', info)
            told = must('info', path)
            self.assertEqual((told['keyframes'], told['reprojection_rms_px'], told['observations_per_point']), (0, None, None))
            recovered = cairn('recover', path, self.folder / 'recovered.cairn')
            self.assertEqual(recovered.code, 1)
            self.assertIn('had no keyframes', recovered.json['error'])
            self.assertFalse((self.folder / 'recovered.cairn').exists())
            coverage = cairn('coverage', path, json_output=False)
            self.assertEqual(coverage.code, 0, coverage.err)
            self.assertIn('no keyframes', coverage.out)
            self.assertNotIn('%', coverage.out)
            self.assertEqual((must('coverage', path)['share'], must('coverage', path)['cells']), (None, []))
            self.assertEqual(cairn('coverage', path, '--fail-below', 0.5).code, 4)
            copy = self.work / 'copy.cairn'
            shutil.copy(path, copy)
            for options in (['--dry-run'], []):
                pruned = cairn('prune', copy, *options, json_output=False)
                self.assertEqual(pruned.code, 0, pruned.err)
                self.assertIn('no keyframes', pruned.out)

    def test_a_picture_of_nothing_costs_no_answer(self):
        picture = self.work / 'x.png'
        for verb in ('info', 'coverage'):
            answer = cairn(verb, self.emptied, '--picture', picture, json_output=False)
            self.assertEqual(answer.code, 0, answer.err)
            self.assertIn('picture: none', answer.out)
            self.assertIsNone(must(verb, self.emptied, '--picture', picture)['picture'])
            self.assertFalse(picture.exists())

    def test_an_image_is_not_located_because_there_is_nothing(self):
        located = cairn('localize', self.image, '--map', self.emptied)
        self.assertEqual(located.code, 4, located.out)
        self.assertEqual(located.json['reason'], 'the map has no keyframes')
        explained = cairn('explain', self.emptied, self.image)
        self.assertEqual((explained.code, explained.json['reason']), (4, 'the map has no keyframes'))
        # Nothing is known of any camera.
        for call in (['localize', self.image, '--map', self.new], ['explain', self.new, self.image]):
            answer = cairn(*call)
            self.assertEqual(answer.code, 1)
            self.assertRegex(answer.json['error'], 'no camera yet.* --camera')

    def test_what_costs_nothing_is_not_minus_nothing(self):
        pruned = cairn('prune', self.whole, '--dry-run', '--redundancy', 0.5, json_output=False)
        packed = cairn('pack', self.whole, '--localization-only', '-o', self.work / 'x.cairn', json_output=False)
        for answer in (pruned, packed):
            self.assertEqual(answer.code, 0, answer.err)
            self.assertTrue(re.search(r'points, no worse than', answer.out), answer.out)
            self.assertNotIn('-0.0', answer.out)


if __name__ == '__main__':
    unittest.main(verbosity=2)
