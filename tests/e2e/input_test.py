"""Recordings as people have them, made here from a rendered one: names, units and formats that are told from one sign only
too easily. What cannot be told is refused; what is understood is said; nothing is wrong in silence."""
import pathlib
import shutil
import tempfile
import unittest

import numpy as np
from PIL import Image, ImageFilter

from cairn_cli import cairn, must

CAMERA = 'model: pinhole\nresolution_px: [640, 480]\nintrinsics_px: [420, 420, 319.5, 239.5]\nrate_hz: 20\n'


class Recordings(unittest.TestCase):
    """A rendered recording, and folders derived from it."""
    DURATION_S = 5

    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix='cairn-e2e-'))
        cls.office = cls.folder / 'office'
        must('synth', 'office', '--seed', 1, '--duration', cls.DURATION_S, '--out', cls.office)
        cls.images = sorted((cls.office / 'mav0' / 'cam0' / 'data').glob('*.png'))[:100]
        cls.poses = [line.split()[1:] for line in (cls.office / 'groundtruth_cam0.txt').read_text().splitlines()
                     if not line.startswith('#')]

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    def path(self, name):
        return self.folder / f'{self.id().split(".")[-1]}_{name}'

    def recording(self, name, camera=CAMERA, **files):
        """A folder with the camera file and, by name, texts."""
        folder = self.path(name)
        folder.mkdir()
        (folder / 'camera.yaml').write_text(camera)
        for file, text in files.items():
            (folder / file.replace('_txt', '.txt')).write_text(text)
        return folder

    def truth(self, name, times, poses=None):
        path = self.path(name)
        path.write_text(''.join(f'{t:.9f} {" ".join(pose)}\n' for t, pose in zip(times, poses or self.poses)))
        return path

    def run_map(self, folder, *arguments):
        self.map, self.frames = self.path(f'{folder.name}.cairn'), self.path(f'{folder.name}.txt')
        return cairn('run', folder, '--map', self.map, '--trajectory', self.frames, '--deterministic', *arguments)

    def ate(self, truth):
        return must('eval', 'ate', self.frames, truth)['ate_m']


class Names(Recordings):
    def test_names_without_zeros_are_taken_in_the_order_of_their_numbers(self):
        folder = self.recording('out')
        for i, image in enumerate(self.images):
            (folder / f'IMG_{i}.png').symlink_to(image)
        answer = self.run_map(folder)
        self.assertEqual(answer.code, 0, answer.out + answer.err)
        self.assertIn('in the order of the numbers', answer.err)
        self.assertIn('IMG_0.png to IMG_99.png', ' '.join(answer.json['input_notes']))
        self.assertLess(self.ate(self.truth('gt.txt', [i / 20 for i in range(100)])), 0.01)

    def test_depth_images_in_the_folder_are_left_out(self):
        depth = np.tile(np.linspace(800, 3000, 640).astype(np.uint16), (480, 1))
        for color, other in (('frame-{:06d}.color.png', 'frame-{:06d}.depth.png'), ('frame{:06d}.png', 'depth{:06d}.png'),
                             ('{:06d}.jpg', '{:06d}.png')):
            folder = self.recording(other.format(0))
            for i, image in enumerate(self.images):
                (folder / color.format(i)).symlink_to(image)  # the content tells the format
                if i < 60:
                    Image.fromarray(np.roll(depth, i, 1)).save(folder / other.format(i))
            answer = cairn('run', folder, '--until', 2, '--odometry-only')
            self.assertEqual(answer.code, 0, answer.out + answer.err)
            self.assertEqual(answer.json['frames'], 40)
            self.assertEqual(answer.json['tracked_share'], 1.0)
            self.assertIn(f'left out: {other.format(0)}', answer.err)

    def test_two_cameras_in_a_folder_are_refused(self):
        for left, right in (('left{:03d}.png', 'right{:03d}.png'), ('cam0_{:03d}.png', 'cam1_{:03d}.png')):
            folder = self.recording(left.format(0))
            for i, image in enumerate(self.images[:50]):
                (folder / left.format(i)).symlink_to(image)
                (folder / right.format(i)).symlink_to(image)
            answer = self.run_map(folder)
            self.assertEqual(answer.code, 1)
            self.assertIn(left.format(0), answer.json['error'])
            self.assertIn(right.format(0), answer.json['error'])
            self.assertFalse(self.map.exists())

    def test_lists_with_backslashes_quotes_and_other_folders(self):
        folder = self.recording('out')
        (folder / 'rgb').mkdir()
        for i, image in enumerate(self.images):
            (folder / 'rgb' / f'{i:04d}.png').symlink_to(image)
        for form in ('{t:.6f} rgb\\{i:04d}.png', '{t:.6f} "rgb/{i:04d}.png"', '"{t:.6f}","rgb/{i:04d}.png"',
                     '{t:.6f};rgb/{i:04d}.png', '{t:.6f} D:\\data\\rgb\\{i:04d}.png',
                     '{t:.6f} /home/me/rgb/{i:04d}.png {t:.6f} /home/me/depth/{i:04d}.png'):
            (folder / 'rgb.txt').write_text(''.join(form.format(t=100 + i / 20, i=i) + '\n' for i in range(100)))
            answer = cairn('run', folder, '--until', 1, '--odometry-only')
            self.assertEqual(answer.code, 0, form + answer.out + answer.err)
            self.assertEqual((answer.json['frames'], answer.json['frames_skipped']), (20, 0), form)

    def test_kitti_with_the_colour_camera_only(self):
        folder = self.path('out')
        (folder / 'image_2').mkdir(parents=True)
        for i, image in enumerate(self.images):
            (folder / 'image_2' / f'{i:06d}.png').symlink_to(image)
        (folder / 'times.txt').write_text(''.join(f'{i / 20:e}\n' for i in range(100)))
        (folder / 'calib.txt').write_text('P0: 400 0 300 0 0 400 200 0 0 0 1 0\nP2: 420 0 319.5 0 0 420 239.5 0 0 0 1 0\n')
        answer = self.run_map(folder)
        self.assertEqual(answer.code, 0, answer.out + answer.err)
        self.assertIn('P2', answer.err)
        self.assertLess(self.ate(self.truth('gt.txt', [i / 20 for i in range(100)])), 0.01)


class Times(Recordings):
    def listed(self, name, times, camera=CAMERA, header=''):
        folder = self.recording(name, camera)
        lines = [f'{time} {image}' for time, image in zip(times, self.images)]
        (folder / 'times.txt').write_text(header + '\n'.join(lines) + '\n')
        return folder

    def test_units_of_times(self):
        without_rate = CAMERA.replace('rate_hz: 20\n', '')
        for name, times in (('ns', [1600000000000000000 + i * 50000000 for i in range(100)]),
                            ('ms', [1600000000000 + i * 50 for i in range(100)]),
                            ('relative_ns', [i * 50000000 for i in range(100)])):
            answer = cairn('run', self.listed(name, times, without_rate), '--until', 1, '--odometry-only')
            self.assertEqual(answer.code, 0, answer.out + answer.err)
            self.assertEqual(answer.json['frames'], 20)
            self.assertIn('the times are', answer.err)
        for name, times in (('frames', range(100)), ('milliseconds', range(0, 5000, 50))):
            refused = cairn('run', self.listed(name, times, without_rate), '--odometry-only')
            self.assertEqual(refused.code, 1, refused.out)
            self.assertRegex(refused.json['error'], 'not clear.*rate_hz')
            answer = cairn('run', self.listed(name + '_rate', times), '--until', 1, '--odometry-only')
            self.assertEqual((answer.code, answer.json['frames']), (0, 20), answer.out + answer.err)
        answer = cairn('run', self.listed('named', range(0, 5000, 50), without_rate, '# time [ms] filename\n'), '--until', 1,
                       '--odometry-only')
        self.assertEqual((answer.code, answer.json['frames']), (0, 20), answer.out + answer.err)

    def trajectory(self, name, form, noise=0.0, header=''):
        """The true poses in a form of line; `noise` in metres."""
        random = np.random.default_rng(3)
        lines = []
        for i, pose in enumerate(self.poses):
            x, y, z, qx, qy, qz, qw = map(float, pose)
            x, y, z = np.array([x, y, z]) + noise * random.normal(size=3)
            a, b, c, d = qx, qy, qz, qw
            r = [1 - 2 * (b * b + c * c), 2 * (a * b - c * d), 2 * (a * c + b * d), 2 * (a * b + c * d), 1 - 2 * (a * a + c * c),
                 2 * (b * c - a * d), 2 * (a * c - b * d), 2 * (b * c + a * d), 1 - 2 * (a * a + b * b)]
            t = 1600000000 + i / 20
            lines.append(form.format(t=t, ns=1600000000000000000 + i * 50000000, i=i, x=x, y=y, z=z, qx=qx, qy=qy, qz=qz, qw=qw,
                                     r=r))
        path = self.path(name)
        path.write_text(header + '\n'.join(lines) + '\n')
        return path

    TUM = '{t:.9f} {x} {y} {z} {qx} {qy} {qz} {qw}'
    KITTI = '{r[0]} {r[1]} {r[2]} {x} {r[3]} {r[4]} {r[5]} {y} {r[6]} {r[7]} {r[8]} {z}'

    def test_kitti_poses_without_times_are_refused(self):
        truth, tum = self.trajectory('poses.txt', self.KITTI), self.trajectory('tum.txt', self.TUM)
        estimate = self.trajectory('estimate.txt', self.KITTI, 0.02)
        whole = self.trajectory('whole.txt', self.KITTI + ' 0 0 0 1')
        for first, second in ((estimate, truth), (tum, truth), (estimate, tum), (whole, tum)):
            for verb in ('ate', 'rpe'):
                answer = cairn('eval', verb, first, second)
                self.assertEqual(answer.code, 1, answer.out)
                self.assertRegex(answer.json['error'], 'KITTI.*times.txt')
        timed = self.trajectory('timed.txt', '{t:.9f} ' + self.KITTI, 0.02)
        self.assertAlmostEqual(must('eval', 'ate', timed, tum)['ate_m'], 0.0335, delta=0.003)

    def test_headers_and_units_are_followed(self):
        truth = self.trajectory('truth.txt', self.TUM)
        estimate = self.trajectory('estimate.txt', self.TUM, 0.001)
        expected = must('eval', 'rpe', estimate, truth)['rpe'][0]['rotation_deg']['rmse']
        euroc = '#timestamp,p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []\n'
        for name, form, header in (('sec.csv', '{t:.9f},{x},{y},{z},{qw},{qx},{qy},{qz}', euroc),
                                   ('named.csv', '{t:.9f},{x},{y},{z},{qw},{qx},{qy},{qz}', 'timestamp,tx,ty,tz,qw,qx,qy,qz\n'),
                                   ('ns.csv', '{ns},{x},{y},{z},{qw},{qx},{qy},{qz}', euroc),
                                   ('ns.txt', '{ns}.000000 {x} {y} {z} {qx} {qy} {qz} {qw}', ''),
                                   ('first.txt', '{qw} {qx} {qy} {qz} {x} {y} {z} {t:.9f}', '# qw qx qy qz tx ty tz t_s\n')):
            reference = self.trajectory(name, form, header=header)
            answer = cairn('eval', 'rpe', estimate, reference)
            self.assertEqual(answer.code, 0, name + answer.out)
            self.assertAlmostEqual(answer.json['rpe'][0]['rotation_deg']['rmse'], expected, delta=1e-3, msg=name)
            self.assertLess(answer.json['rpe'][0]['translation_m']['rmse'], 0.01, name)

    def test_frame_numbers_and_times_are_not_paired(self):
        truth = self.trajectory('truth.txt', '{i} {x} {y} {z} {qx} {qy} {qz} {qw}')
        estimate = self.trajectory('estimate.txt', '{i} {x} {y} {z} {qx} {qy} {qz} {qw}', 0.02)
        seconds = self.path('seconds.txt')
        seconds.write_text(''.join(f'{i / 20:.3f} {" ".join(pose)}\n' for i, pose in enumerate(self.poses)))
        self.assertAlmostEqual(must('eval', 'ate', estimate, truth)['ate_m'], 0.0335, delta=0.003)
        for first, second in ((estimate, seconds), (seconds, truth)):
            answer = cairn('eval', 'ate', first, second)
            self.assertEqual(answer.code, 1, answer.out)
            self.assertIn('counted frames', answer.json['error'])


class Images(Recordings):
    """What is not of the scene in the images, or is lost on the way to 8 bits."""

    def spoiled(self, name, change, count=100):
        folder = self.recording(name)
        for i, image in enumerate(self.images[:count]):
            Image.fromarray(change(i, np.asarray(Image.open(image)))).save(folder / f'{i:04d}.png', compress_level=1)
        return folder

    def check(self, folder, note, ate_m, rate_hz=20, step=1):
        answer = self.run_map(folder)
        self.assertEqual(answer.code, 0, answer.out + answer.err)
        self.assertRegex(' '.join(answer.json.get('input_notes', [])), note)
        self.assertEqual(answer.json['tracked_share'], 1.0)
        poses = self.poses[:100:step]
        self.assertLess(self.ate(self.truth(f'{folder.name}.gt.txt', [i / rate_hz for i in range(len(poses))], poses)), ate_m)

    def test_sixteen_bits_of_which_fewer_are_used(self):
        for name, scale, offset, note in (('10', 4, 0, 'from 0 to 1023'), ('12', 16, 0, 'from 0 to 4095'),
                                          ('14', 64, 0, 'from 0 to 16383'), ('thermal', 4, 7200, 'have 16 bits')):
            self.check(self.spoiled(name, lambda i, gray: (gray.astype(np.uint16) * scale + offset).astype(np.uint16)), note, 0.02)

    def test_bands_of_light_are_evened_out(self):
        rows = np.arange(480)[:, None]
        self.check(self.spoiled('out', lambda i, gray: (gray * (0.85 + 0.15 * np.sin(2 * np.pi * (rows / 160 + 0.37 * i)))).astype(
            np.uint8)), 'bands of light', 0.03)

    def test_half_pictures_woven_into_one(self):
        folder = self.recording('out', CAMERA.replace('rate_hz: 20', 'rate_hz: 10'))
        for i in range(50):
            woven = np.array(Image.open(self.images[2 * i]))
            woven[1::2] = np.asarray(Image.open(self.images[2 * i + 1]))[1::2]
            Image.fromarray(woven).save(folder / f'{i:04d}.png', compress_level=1)
        self.check(folder, 'interlaced', 0.02, 10, 2)

    def test_what_is_fixed_to_the_camera_is_found_or_masked(self):
        y, x = np.mgrid[0:480, 0:640]
        bonnet = ((x - 320) / (0.62 * 640)) ** 2 + ((y - 480) / (0.35 * 480)) ** 2 < 1
        paint = np.asarray(Image.fromarray(np.random.default_rng(0).integers(0, 255, (120, 160)).astype(np.uint8)).resize(
            (640, 480), Image.BICUBIC))
        folder = self.spoiled('out', lambda i, gray: np.where(bonnet, paint, gray))
        self.check(folder, r'\d+ % of the view \(at the bottom\) does not move with the scene', 0.03)
        mask = self.path('mask.png')
        Image.fromarray(np.where(bonnet, 0, 255).astype(np.uint8)).save(mask)
        answer = self.run_map(folder, '--mask', mask, '--overwrite')
        self.assertEqual(answer.code, 0, answer.out)
        self.assertNotIn('input_notes', answer.json)
        self.assertLess(self.ate(self.truth('gt.txt', [i / 20 for i in range(100)])), 0.03)
        located = must('localize', folder / '0050.png', '--camera', folder / 'camera.yaml', '--map', self.map, '--mask', mask)
        self.assertTrue(located['localized'])
        tracked = must('track', folder, '--map', self.map, '--mask', mask, '--deterministic')
        self.assertGreater(tracked['with_pose_share'], 0.95)
        Image.fromarray(np.zeros((480, 640), np.uint8)).save(mask)
        self.assertIn('shows 0.0 % of the view', cairn('run', folder, '--mask', mask, '--odometry-only').json['error'])

    def test_frames_before_the_first_motion_have_poses(self):
        crop = lambda path: Image.open(path).crop((128, 96, 512, 384))
        for idle in (40, 100):
            folder = self.recording(f'idle{idle}', CAMERA.replace('[640, 480]', '[384, 288]').replace('319.5, 239.5', '191.5, 143.5'))
            for i, image in enumerate([self.images[0]] * idle + self.images):
                crop(image).save(folder / f'{i:04d}.png', compress_level=1)
            answer = self.run_map(folder)
            self.assertEqual(answer.code, 0, answer.out + answer.err)
            self.assertEqual(answer.json['frames_tracked'], idle + 100)

    def test_without_a_map_the_stage_is_named_and_the_poses_are_written(self):
        folder = self.spoiled('out', lambda i, gray: np.asarray(Image.fromarray(gray).filter(ImageFilter.GaussianBlur(12))))
        answer = self.run_map(folder)
        self.assertEqual(answer.code, 1, answer.out)
        self.assertRegex(answer.json['error'], 'the odometry tracked .* but the feature module could not start')
        self.assertIn(str(self.frames), answer.json['error'])
        self.assertGreater(len(self.frames.read_text().splitlines()), 20)


class Sizes(unittest.TestCase):
    """The same scene in few pixels or many, sharp or soft, gives a map."""

    def test_a_scene_gives_a_map_at_every_size(self):
        with tempfile.TemporaryDirectory(prefix='cairn-e2e-') as name:
            folder, errors, maps = pathlib.Path(name), {}, {}
            for width, height, focal in ((160, 120, 105), (320, 240, 210), (640, 480, 420), (1920, 1080, 1260)):
                sharp = folder / f'{width}'
                must('synth', 'office', '--seed', 1, '--duration', 4, '--rate', 15, '--image-size', width, height, '--focal', focal,
                     '--out', sharp)
                soft = folder / f'{width}_soft'
                shutil.copytree(sharp, soft)
                for image in (soft / 'mav0' / 'cam0' / 'data').glob('*.png'):
                    blurred = Image.open(image).filter(ImageFilter.GaussianBlur(2 * width / 1920))
                    blurred.save(image, compress_level=1)
                for recording in (sharp, soft):
                    maps[recording.name], frames = folder / f'{recording.name}.cairn', folder / f'{recording.name}.txt'
                    report = must('run', recording, '--map', maps[recording.name], '--trajectory', frames, '--deterministic')
                    self.assertEqual(report['tracked_share'], 1.0, recording.name)
                    errors[recording.name] = must('eval', 'ate', frames, recording / 'groundtruth_cam0.txt')['ate_m']
            for recording, error in errors.items():
                self.assertLess(error, max(2 * errors['640'], 0.01), f'{recording}: {errors}')
            # Photos of many times the map's pixels, and of few.
            for photos, of in (('1920', '320'), ('1920_soft', '640'), ('320', '1920'), ('640', '1920_soft')):
                answer = must('localize', folder / photos, '--independent', '--stride', 6, '--map', maps[of])
                self.assertGreaterEqual(answer['localized_share'], 0.9, f'{photos} in {of}')


class Calibrations(Recordings):
    DURATION_S = 3

    def test_what_no_lens_is_is_refused_everywhere(self):
        good, map = self.path('good.yaml'), self.path('map.cairn')
        good.write_text(CAMERA)
        must('run', self.office, '--map', map)
        for name, numbers, why in (('mm', '3.637, 3.638, 320, 240', 'millimetres'), ('relative', '0.65625, 0.875, 0.5, 0.5', 'shares'),
                                   ('corner', '420, 420, 0, 0', 'principal point'), ('axes', '420, 4.2, 319.5, 239.5', 'factor')):
            camera = self.path(f'{name}.yaml')
            camera.write_text(CAMERA.replace('420, 420, 319.5, 239.5', numbers))
            for arguments in (['run', self.office, '--map', self.path('x.cairn')], ['run', self.office, '--odometry-only'],
                              ['run', self.office, '--map', map, '--extend'], ['localize', self.images[9], '--map', map],
                              ['localize', self.office, '--independent', '--map', map], ['track', self.office, '--map', map]):
                answer = cairn(*arguments, '--camera', camera)
                self.assertEqual(answer.code, 1, arguments)
                self.assertRegex(answer.json['error'], f'no lens has this calibration.*{why}')
        self.assertFalse(self.path('x.cairn').exists())
        camera.write_text(CAMERA.replace('319.5, 239.5', '160, 120'))
        self.assertIn('the calibration is unusual', cairn('run', self.office, '--odometry-only', '--camera', camera).err)


if __name__ == '__main__':
    unittest.main(verbosity=2)
