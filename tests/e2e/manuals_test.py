"""Man pages and bash completion, made from --help: every verb has a page, man takes it, and words are completed."""
import pathlib
import re
import shutil
import subprocess
import tempfile
import unittest

from cairn_cli import BINARY, cairn

MAKE = pathlib.Path(__file__).parents[2] / 'tools/make_manuals'


class Manuals(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix='cairn-e2e-'))
        subprocess.run([MAKE, BINARY, cls.folder], check=True, timeout=120)

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    def complete(self, *words):
        script = ('source "$1"; shift; COMP_WORDS=("$@"); COMP_CWORD=$(($#-1)); _cairn; printf "%s\\n" "${COMPREPLY[@]}"')
        done = subprocess.run(['bash', '-c', script, 'bash', self.folder / 'bash-completion/cairn', 'cairn', *map(str, words)],
                              capture_output=True, text=True, check=True, timeout=30, cwd=self.folder)
        return done.stdout.split()

    def test_every_verb_has_a_page_with_its_options(self):
        text = cairn('--help', json_output=False).out
        verbs = re.findall(r'^  ([a-z]+)  ', text[text.index('Subcommands:'):], flags=re.M)
        self.assertIn('info', verbs)
        for verb in verbs:
            self.assertTrue((self.folder / f'man1/cairn-{verb}.1').exists(), verb)
        page = (self.folder / 'man1/cairn-ls.1').read_text().replace('\\-', '-')
        self.assertIn('--filter', page)
        self.assertIn('cairn ls office.cairn', page)

    def test_what_a_server_does_not_do_is_said(self):
        """Of each option of run: that it is not with --server, if and only if it is refused."""
        entries = re.split(r'^  (?=-)', cairn('run', '--help', json_output=False).out, flags=re.M)[1:]
        told, refused = set(), set()
        for entry in entries:
            name = re.match(r'(?:-\w,)?(--[\w-]+)', entry)[1]
            if 'Not with --server' in ' '.join(entry.split()):
                told.add(name)
            to_map = [] if name == '--odometry-only' else ['--map', 'x']  # which exclude each other
            for value in ([], ['1'], ['fast']):
                answer = cairn('--server', 'localhost:1', 'run', '.', *to_map, name, *value, json_output=False)
                if '--server' in answer.err and 'excludes' in answer.err:
                    refused.add(name)
        self.assertIn('--threads', told)
        self.assertEqual(told, refused)

    def test_man_takes_the_pages(self):
        if shutil.which('man') is None or shutil.which('groff') is None:
            self.skipTest('man or groff is not installed')
        for page in sorted((self.folder / 'man1').iterdir()):
            done = subprocess.run(['man', '--warnings=w', '-l', page], capture_output=True, text=True, timeout=30,
                                  env={'PATH': '/usr/bin:/bin', 'LC_ALL': 'C.UTF-8', 'MANPAGER': 'cat', 'MANWIDTH': '200'})
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertEqual(done.stderr, '', page)

    def test_words_are_completed(self):
        self.assertEqual(self.complete('inf'), ['info'])
        self.assertEqual(self.complete('ls', '--fil'), ['--filter'])
        self.assertIn('ate', self.complete('eval', ''))
        self.assertEqual(self.complete('--server', 'localhost:7878', 'inf'), ['info'])
        (self.folder / 'office.cairn').touch()
        self.assertEqual(self.complete('info', 'off'), ['office.cairn'])
        self.assertEqual(self.complete('info', 'office.cairn', '--picture', 'off'), ['office.cairn'])

    def test_choices_are_completed(self):
        (self.folder / 'office.cairn').touch()
        self.assertIn('colmap-text', self.complete('export', 'office.cairn', 'model', '--format', ''))
        self.assertEqual(self.complete('render', 'office.cairn', '--view', 'pe'), ['perspective'])
        self.assertEqual(sorted(self.complete('show', 'office.cairn', '')),
                         ['camera', 'component', 'keyframe', 'point', 'session'])
        self.assertEqual(self.complete('show', 'off'), ['office.cairn'])
        self.assertEqual(self.complete('ls', '--limit', 3, 'office.cairn', 'se'), ['sessions'])
        self.assertEqual(self.complete('--server', 'localhost:7878', 'ls', 'office', 'se'), ['sessions'])
        self.assertEqual(self.complete('ls', 'office.cairn', '--sort', 'par'), ['parallax_deg'])
        self.assertEqual(self.complete('align', 'office.cairn', '--up', '-'), ['-x', '-y', '-z'])

    def test_names_are_those_that_can_be_typed(self):
        for page in [*(self.folder / 'man1').iterdir(), self.folder / 'bash-completion/cairn']:
            self.assertNotRegex(page.read_text(), r'-[a-z]+\{', page)
        self.assertIn('--alike', self.complete('synth', 'map', '--al'))


if __name__ == '__main__':
    unittest.main(verbosity=2)
