"""Map files of every released format (tests/golden): localized against as they are, brought up to date, and again."""
import math
import os
import pathlib
import shutil
import sqlite3
import tempfile
import unittest

from cairn_cli import cairn, must

GOLDEN = pathlib.Path(__file__).parent.parent / 'golden'


def user_version(path):
    return int.from_bytes(path.read_bytes()[60:64], 'big')


class GoldenFiles(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, self.folder)

    def locate(self, map_file, image='query.png'):
        return must('localize', GOLDEN / image, '--camera', GOLDEN / 'camera.yaml', '--map', map_file)

    def expect_at(self, answer, position, within):
        self.assertLess(math.dist(answer['position'], position), within, answer)

    def reference(self):
        """The poses of the first seven keyframes, as make_golden.cc placed and aligned them."""
        lines = []
        for i in range(7):
            yaw = 0.4 * math.sin(0.8 * i)
            x, y, z = 2.0 * (-1.0 + 0.3 * i) + 10.0, 2.0 * 0.1 * math.sin(i), 2.0 * -1.5
            lines.append(f'{i} {x:.6f} {y:.6f} {z:.6f} 0 {math.sin(yaw / 2):.8f} 0 {math.cos(yaw / 2):.8f}')
        path = self.folder / 'poses.txt'
        path.write_text('\n'.join(lines) + '\n')
        return path

    def test_each(self):
        files = sorted(GOLDEN.glob('format*.cairn'))
        self.assertGreaterEqual(len(files), 2)
        for golden in files:
            with self.subTest(golden.name):
                self.check(golden)

    def check(self, golden):
        before = golden.read_bytes()
        version = user_version(golden)
        self.assertEqual(golden.name[6], str(version))
        map_file = self.folder / golden.name
        map_file.write_bytes(before)
        digest = must('info', map_file, '--digest')['digest']
        parts = 'parts' in golden.name
        self.expect_at(self.locate(map_file), (10.1, 0.1, -2.7), 0.03)
        if parts:
            self.expect_at(self.locate(map_file, 'query_parts.png'), (0.05, 0.05, 0.4), 0.03)
        # Read, and nothing else.
        self.assertEqual(map_file.read_bytes(), before)
        self.assertEqual(golden.read_bytes(), before)

        # Whoever writes brings it up to date, and keeps it as it was.
        aligned = cairn('align', map_file, '--groundtruth', self.reference(), '--overwrite')
        self.assertEqual(aligned.code, 0, aligned.out + aligned.err)
        backup = pathlib.Path(f'{map_file}.format{version}-backup')
        self.assertGreater(user_version(map_file), version)
        self.assertEqual(user_version(backup), version)
        self.assertEqual(must('info', backup, '--digest')['digest'], digest)
        self.expect_at(self.locate(map_file), (10.1, 0.1, -2.7), 0.03)
        if parts:
            self.expect_at(self.locate(map_file, 'query_parts.png'), (0.05, 0.05, 0.4), 0.03)
        with sqlite3.connect(f'file:{map_file}?mode=ro', uri=True) as database:
            self.assertEqual(database.execute('PRAGMA integrity_check').fetchall(), [('ok',)])
            self.assertEqual(database.execute('PRAGMA foreign_key_check').fetchall(), [])
            self.assertEqual(database.execute('SELECT components FROM overview').fetchone(), (2 if parts else 1,))


if __name__ == '__main__':
    unittest.main()
