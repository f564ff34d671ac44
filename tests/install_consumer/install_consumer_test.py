#!/usr/bin/env python3
"""Installs Cairn to a folder, moves that elsewhere, and builds programs against it as a user does: the examples and two of our
own with CMake, one with pkg-config; then runs them on a small map. Environment: CAIRN_BUILD (build folder), CMAKE, MAKE_MAP,
CAIRN_SOURCE."""
import json
import os
import pathlib
import shlex
import shutil
import subprocess
import tempfile
import unittest

SOURCE = pathlib.Path(os.environ['CAIRN_SOURCE'])
HERE = SOURCE / 'tests' / 'install_consumer'
CMAKE = os.environ['CMAKE']


def run(*command, code=0, **options):
    """Its standard output; fails the test if the exit code is another one."""
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, timeout=300, **options)
    if done.returncode != code:
        raise AssertionError(f'{shlex.join(map(str, command))}: exit code {done.returncode}, not {code}\n'
                             f'{done.stdout[-4000:]}\n{done.stderr[-4000:]}')
    return done.stdout


class InstallConsumer(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix='cairn_install_'))
        cls.addClassCleanup(shutil.rmtree, cls.folder, ignore_errors=True)
        run(CMAKE, '--install', os.environ['CAIRN_BUILD'], '--prefix', cls.folder / 'first')
        cls.prefix = cls.folder / 'moved here'  # nothing may depend on where it was put first, or on a plain name
        (cls.folder / 'first').rename(cls.prefix)
        cls.data = cls.folder / 'data'
        cls.data.mkdir()
        run(os.environ['MAKE_MAP'], cls.data)
        cls.map, cls.photo = cls.data / 'room.cairn', cls.data / 'photo.pgm'
        cls.consumer = cls.build(HERE / 'consumer', 'consumer')
        cls.examples = cls.build(cls.prefix / 'share' / 'doc' / 'cairn' / 'examples', 'examples')

    @classmethod
    def build(cls, source, name):
        folder = cls.folder / f'build_{name}'
        run(CMAKE, '-S', source, '-B', folder, f'-DCMAKE_PREFIX_PATH={cls.prefix}', '-DCMAKE_BUILD_TYPE=Release')
        run(CMAKE, '--build', folder, '-j2')
        return folder

    def test_programs_with_cmake(self):
        before = self.map.read_bytes()
        self.assertIn('all is well', run(self.consumer / 'robot', self.map, self.photo))
        self.assertIn('all is well', run(self.consumer / 'robot_c', self.map))
        self.assertEqual(self.map.read_bytes(), before, 'the map was only read')

    def test_program_with_pkg_config(self):
        pkg = dict(os.environ, PKG_CONFIG_PATH=str(next(self.prefix.glob('lib/**/pkgconfig'))))
        flags = shlex.split(run('pkg-config', '--cflags', '--libs', 'cairn', env=pkg))
        self.assertEqual(run('pkg-config', '--modversion', 'cairn', env=pkg).strip(), '0.1.0')
        library = next(self.prefix.glob('lib/**/libcairn.so')).parent
        program = self.folder / 'localize'
        run('cc', '-std=c99', '-o', program, SOURCE / 'examples' / 'localize.c', *flags, f'-Wl,-rpath,{library}')
        self.assertIn('10.4', run(program, self.map, self.photo))

    def test_the_program_finds_its_data(self):
        cairn, vocabulary = self.prefix / 'bin' / 'cairn', self.prefix / 'share' / 'cairn' / 'default_vocabulary.cairnvoc'
        self.assertGreater(json.loads(run(cairn, 'vocab', 'info', '--json'))['words'], 90000)
        # Its own, not that of the source tree.
        kept = vocabulary.read_bytes()
        vocabulary.write_text('no vocabulary')
        self.addCleanup(vocabulary.write_bytes, kept)
        done = subprocess.run([cairn, 'vocab', 'info'], capture_output=True, text=True, timeout=60)
        self.assertNotEqual(done.returncode, 0)
        self.assertIn(str(vocabulary), done.stderr)

    def test_localize_photo(self):
        out = run(self.examples / 'localize_photo', self.map, self.data / 'photo.png')
        self.assertRegex(out, r'^10\.[34]\d* -?0\.0\d* -2\.[78]\d* m, \+- 0\.0\d+, in component 1 of revision 1\nlooks along 0\.0')
        out = run(self.examples / 'localize_photo', self.map, self.data / 'photo.png', 350, 350, 239.5, 179.5)
        self.assertIn('10.', out)
        self.assertIn('not located at stage', run(self.examples / 'localize_photo', self.map, self.data / 'elsewhere.pgm',
                                                  code=4))
        run(self.examples / 'localize_photo', self.data / 'none.cairn', self.photo, code=1)
        run(self.examples / 'localize_photo', self.map, self.map, code=1)
        run(self.examples / 'localize_photo', code=2)

    def test_localize_c(self):
        self.assertRegex(run(self.examples / 'localize', self.map, self.photo), r'^10\.[34]\d* .* m, \+- 0\.0')
        self.assertIn('not located at stage', run(self.examples / 'localize', self.map, self.data / 'elsewhere.pgm', code=4))
        run(self.examples / 'localize', self.map, self.data / 'photo.png', code=1)

    def test_follow_growing_map(self):
        growing = self.data / 'growing.cairn'
        with subprocess.Popen([os.environ['MAKE_MAP'], '--grow', growing], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                              text=True) as writer:
            self.assertEqual(writer.stdout.readline(), 'ready\n')
            with subprocess.Popen([self.examples / 'follow_growing_map', growing, self.data / 'photo.png', '60'],
                                  stdout=subprocess.PIPE, text=True) as follower:
                self.assertEqual(follower.stdout.readline(), 'revision 0: 0 keyframes, still empty\n')
                writer.communicate('\n', timeout=60)
                self.assertRegex(follower.communicate(timeout=60)[0], r'^revision 1: 10 keyframes, located at 10\.[34]')
            self.assertEqual(follower.returncode, 0)
        self.assertEqual(writer.returncode, 0)

    def test_track_folder(self):
        done = subprocess.run([self.examples / 'track_folder', self.map, self.data / 'frames'], capture_output=True,
                              text=True, timeout=60)
        self.assertEqual(done.returncode, 0, done.stderr)
        poses = [line for line in done.stdout.splitlines() if not line.startswith('#')]
        self.assertGreaterEqual(len(poses), 25, done.stdout)
        for line in poses:
            time_s, x, y, z = map(float, line.split()[:4])
            self.assertAlmostEqual(x, 10.0 + 2.0 * (-0.6 + 0.03 * round(30.0 * time_s - 1)), delta=0.1, msg=line)


if __name__ == '__main__':
    unittest.main(verbosity=2)
