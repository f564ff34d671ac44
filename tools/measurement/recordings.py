"""Recordings as people have them: short and fast, hard ones, large and small images, something that moves, a start in a
turn, straight ways; and whether a trajectory knows how sure it is."""
import csv
import math
import statistics

import numpy as np
from PIL import Image, ImageFilter

from .trajectories import apply_similarity, read_positions, similarity
from .work import DATA, cairn, rendered

STILL_S = ((0.3, 4.7), (9.3, 14.7), (18.3, 22.0))  # of the desk of `cairn synth`
SPIN_S = 3.0


def paired(frames, truth):
    estimated, true = read_positions(frames), read_positions(truth)
    nearest = np.abs(true[:, 0][None, :] - estimated[:, 0][:, None]).argmin(axis=1)
    close = np.abs(true[nearest, 0] - estimated[:, 0]) < 0.02
    return estimated[close], true[nearest[close]]


def errors(frames, truth):
    """Times, distances from the truth after the best similarity, and that similarity's scale."""
    estimated, true = paired(frames, truth)
    transform = similarity(true[:, 1:], estimated[:, 1:])
    return estimated[:, 0], np.linalg.norm(apply_similarity(transform, estimated[:, 1:]) - true[:, 1:], axis=1), transform[0]


def rms(values):
    return math.sqrt(float(np.mean(np.square(values)))) if len(values) else 0.0


def part_scales(frames, truth, parts=10, least_m=0.05):
    """Of each part of a trajectory that moves, true lengths over estimated ones."""
    estimated, true = paired(frames, truth)
    scales = []
    for a, b in zip(np.array_split(estimated, parts), np.array_split(true, parts)):
        a, b = a[:, 1:] - a[:, 1:].mean(axis=0), b[:, 1:] - b[:, 1:].mean(axis=0)
        if len(b) > 2 and rms(np.linalg.norm(b, axis=1)) > least_m:
            scales.append(math.sqrt((b ** 2).sum() / max((a ** 2).sum(), 1e-300)))
    return scales


class Recordings:
    def assessed(self, tag, sequence, truth, *arguments):
        """A map, the errors of its frames against what it claims of them."""
        frames, quality = self.path(f'{tag}.txt'), self.path(f'{tag}.csv')
        report = cairn('run', sequence, *arguments, *self.mode, '--map', self.path(f'{tag}.cairn'), '--trajectory', frames,
                       '--quality', quality, '--overwrite')
        times, off, scale = errors(frames, truth)
        rows = list(csv.DictReader(open(quality)))
        claimed = np.array([float(row['t']) for row in rows])
        claims = [rows[np.abs(claimed - t).argmin()] for t in times]
        sigma = scale * math.sqrt(3.0) * np.array([float(row['sigma_position']) for row in claims])
        sure = np.array([float(row['quality']) >= 0.5 for row in claims])
        return {'ate': rms(off), 'tracked': report['tracked_share'], 'ratio': rms(off) / max(rms(sigma), 1e-12),
                'quality': report['quality']['trajectory'], 'unsure': 1.0 - float(sure.mean()),
                'wrong_and_sure': int(np.sum((off > 0.3) & sure)), 'wrong': int(np.sum(off > 0.3))}

    def real(self, name, truth, camera=True):
        """Median of --runs, but the worst for what must not be."""
        def one():
            arguments = ['--camera', DATA / name / 'camera.yaml'] if camera else []
            runs = [self.assessed(f'assessed_{name}_{run}', DATA / name, DATA / name / truth, *arguments)
                    for run in range(self.runs)]
            print(f'        {name}: {runs}', flush=True)
            return {**{key: statistics.median(run[key] for run in runs) for key in runs[0]},
                    'worst': max(run['ate'] for run in runs), 'wrong_and_sure': max(run['wrong_and_sure'] for run in runs)}
        return self.once(f'assessed {name}', one)

    def over_seeds(self, kind, function):
        def one(seed):
            folder = self.world(kind, seed)
            result = function(seed, folder, self.truth(folder))
            print(f'        {kind} {seed}: {result}', flush=True)
            return result

        def all_seeds():
            results = [one(seed) for seed in range(1, self.seeds + 1)]
            return {key: (statistics.median(r[key] for r in results), max(r[key] for r in results),
                          min(r[key] for r in results)) for key in results[0]}
        return self.once(f'recordings {kind}', all_seeds)

    def rooms_assessed(self, kind):
        return self.over_seeds(kind, lambda seed, folder, truth: self.assessed(f'assessed_{kind}_{seed}', folder, truth))

    def desk(self):
        def one(seed, folder, truth):
            result = self.assessed(f'desk_{seed}', folder, truth)
            times, off, _ = errors(self.path(f'desk_{seed}.txt'), truth)
            still = np.zeros(len(times), bool)
            for begin, end in STILL_S:
                at = times - read_positions(truth)[0, 0]
                still |= (at > begin) & (at < end)
            return {**result, 'still': rms(off[still])}
        return self.over_seeds('desk', one)

    def spin(self):
        def one(seed, folder, truth):
            result = self.assessed(f'spin_{seed}', folder, truth)
            frames = self.path(f'spin_{seed}.txt')
            scales = part_scales(frames, truth)
            middle = statistics.median(scales)
            times = read_positions(frames)[:, 0] - read_positions(truth)[0, 0]
            return {**result, 'scale': max(abs(s / middle - 1.0) for s in scales),
                    'walk_tracked': float((times > SPIN_S).sum()) / (len(read_positions(truth)) - 20 * SPIN_S)}
        return self.over_seeds('spin', one)

    def straight(self, kind):
        def one(seed, folder, truth):
            result = self.assessed(f'{kind}_{seed}', folder, truth)
            scales = part_scales(self.path(f'{kind}_{seed}.txt'), truth)
            return {**result, 'scale': abs(scales[-1] / scales[0] - 1.0)}
        return self.over_seeds(kind, one)

    def office_at(self, width, height, blur_px=0.0):
        """The same 8 s of an office at another size, against 640 x 480."""
        def one():
            def ate(w, h, blur):
                name = f'size_{w}x{h}'
                focal = 420.0 * h / 480.0
                world = rendered(self.worlds / name, 'office', '--image-size', w, h, '--focal', focal, '--rate', 15, '--duration', 6)
                truth = self.truth(world)
                if blur > 0.0:
                    world = self.changed(world, self.worlds / f'{name}_soft', lambda image: blurred(image, blur))
                frames = self.path(f'{world.name}.txt')
                report = cairn('run', world, *self.mode, '--map', self.path(f'{world.name}.cairn'), '--trajectory', frames, '--overwrite')
                return rms(errors(frames, truth)[1]), report['tracked_share'], report['peak_mb']
            error, tracked, peak = ate(width, height, blur_px * height / 1080.0)
            return {'ate': error, 'against': error / ate(640, 480, 0.0)[0], 'tracked': tracked, 'peak_mb': peak}
        return self.once(f'office {width} {height} {blur_px}', one)

    def kitchen_at(self, factor):
        """Redkitchen's first 20 s enlarged or reduced."""
        def one():
            name = f'kitchen_x{factor:g}'
            folder, source = self.worlds / name, DATA / 'redkitchen'
            if not folder.exists():
                partial = folder.with_name(f'{name}.partial')
                (partial / 'rgb').mkdir(parents=True, exist_ok=True)
                first = None
                lines = []
                for line in open(source / 'rgb.txt'):
                    if line.startswith('#') or not line.strip():
                        continue
                    time, path = line.split()
                    first = float(time) if first is None else first
                    if float(time) - first >= 12.0:
                        break
                    image = Image.open(source / path).convert('L')
                    size = (round(image.width * factor), round(image.height * factor))
                    image.resize(size, Image.Resampling.BICUBIC if factor > 1 else Image.Resampling.BOX).save(
                        partial / 'rgb' / f'{time}.png', compress_level=1)
                    lines.append(f'{time} rgb/{time}.png\n')
                (partial / 'rgb.txt').write_text(''.join(lines))
                (partial / 'camera.yaml').write_text(
                    f'model: pinhole\nresolution_px: [{round(640 * factor)}, {round(480 * factor)}]\n'
                    f'intrinsics_px: [{525 * factor}, {525 * factor}, {320.5 * factor - 0.5}, {240.5 * factor - 0.5}]\nrate_hz: 30\n')
                partial.rename(folder)
            frames = self.path(f'{name}.txt')
            report = cairn('run', folder, '--camera', folder / 'camera.yaml', *self.mode, '--map', self.path(f'{name}.cairn'),
                           '--trajectory', frames, '--overwrite')
            ate = cairn('eval', 'ate', frames, source / 'reference_sfm.txt', '--max-dt', 0.005)['ate_m']
            return {'ate': ate, 'tracked': report['tracked_share'], 'peak_mb': report['peak_mb']}
        return self.once(f'kitchen {factor}', one)

    def changed(self, world, folder, function):
        """A copy of an EuRoC folder with other images."""
        if not folder.exists():
            partial = folder.with_name(f'{folder.name}.partial')
            images = partial / 'mav0' / 'cam0' / 'data'
            images.mkdir(parents=True, exist_ok=True)
            for name in ('data.csv', 'sensor.yaml'):
                (partial / 'mav0' / 'cam0' / name).write_bytes((world / 'mav0' / 'cam0' / name).read_bytes())
            for path in sorted((world / 'mav0' / 'cam0' / 'data').glob('*.png')):
                function(Image.open(path)).save(images / path.name, compress_level=1)
            partial.rename(folder)
        return folder


def blurred(image, sigma_px):
    return image.filter(ImageFilter.GaussianBlur(sigma_px))
