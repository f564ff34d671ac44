"""Recordings that were spoiled for a moment: black, truncated and blurred images, gaps, jumps of the exposure, an obstacle
before half of the view. Copies are made in a folder of its own; what stays as it was is linked."""
import statistics

import numpy as np
from PIL import Image, ImageFilter

from .trajectories import read_positions
from .work import DATA, cairn

FRAMES = {'black': 5, 'truncated': 5, 'gap': 15, 'darker': 10000, 'blurred': 5}
COVERED_FRAMES = 30
TIMES_S = (6.0, 8.0, 10.0)  # of the damage, one run each
COVERED_TIMES_S = tuple(float(t) for t in range(3, 13))
# Long gaps: all pairs of these, until some seconds after the gap.
GAPS_S, GAP_TIMES_S, AFTER_GAP_S = (1.0, 2.0), (1.5, 2, 2.5, 3, 3.5, 4, 4.5, 5, 5.5, 6, 8, 10, 12), 4.0


def texture(shape, seed=7, cell_px=14):
    """Smooth noise, as cloth or a printed page, seeded."""
    height, width = shape
    coarse = np.random.default_rng(seed).integers(20, 236, (height // cell_px + 2, width // cell_px + 2), dtype=np.uint8)
    return np.array(Image.fromarray(coarse).resize((width, height), Image.Resampling.BICUBIC))


def cover(kind, pixels, at):
    """Puts an obstacle before the view; `at` runs from 0 to 1 while it is there."""
    height, width = pixels.shape[:2]
    y, x = np.mgrid[0:height, 0:width]
    board = (60 + 40 * ((x // 17 + y // 23) % 2)).astype(np.uint8)
    where = {'half covered': x < width // 2, 'right half covered': x >= width // 2,
             'top half covered': y < height // 2, 'half covered by cloth': x < width // 2,
             'half covered by a plain board': x < width // 2, 'half covered, drifting': x < width // 2}.get(kind)
    if kind == 'half covered by a plain board':
        board = np.full_like(board, 90)
    elif kind == 'half covered by cloth':
        board = texture((height, width))
    elif kind == 'half covered, drifting':  # the pattern moves on its own
        large = texture((2 * height, 2 * width))
        board = large[int(0.1 * height * at):, int(0.3 * width * at):][:height, :width]
    elif kind == 'passed by':  # from the left edge to the right one and out again
        begin = int((1.4 * at - 0.4) * width)
        where = (x >= begin) & (x < begin + int(0.4 * width))
        board = np.roll(texture((height, width)), begin, axis=1)
    pixels[where] = board[where] if pixels.ndim == 2 else board[where][:, None]


def spoiled(kind, source, target, at):
    """Writes the spoiled image, `at` from 0 (the first) to 1 (the last); False: it is left out."""
    if kind == 'gap':
        return False
    if kind == 'truncated':
        data = source.read_bytes()
        target.write_bytes(data[:len(data) // 3])
        return True
    image = Image.open(source)
    if kind == 'blurred':
        image = image.filter(ImageFilter.GaussianBlur(8))
    pixels = np.array(image)
    if kind == 'black':
        pixels[:] = 0
    elif kind == 'darker':
        pixels = (0.6 * pixels).astype(np.uint8)
    elif kind not in FRAMES:
        cover(kind, pixels, at)
    Image.fromarray(pixels).save(target, format='PNG')
    return True


def spoil(kind, at_s, folder, until_s, count=None):
    """A copy of redkitchen with damage from `at_s` on; the times of the `count` images that were spoiled or left out."""
    source = DATA / 'redkitchen'
    (folder / 'rgb').mkdir(parents=True)
    lines, times, count = [], [], count or FRAMES.get(kind, COVERED_FRAMES)
    for line in open(source / 'rgb.txt'):
        if line.startswith('#') or not line.strip():
            continue
        time, name = line.split()
        if float(time) > until_s:
            break
        target = folder / name
        if kind and float(time) >= at_s and len(times) < count:
            times.append(float(time))
            if not spoiled(kind, source / name, target, (len(times) - 1) / (count - 1)):
                continue
        else:
            target.symlink_to((source / name).resolve())
        lines.append(line)
    (folder / 'rgb.txt').write_text(''.join(lines))
    return times


# A camera that sees nothing for two seconds and is then somewhere else, where it has been before.
BEFORE_S, BLACK_S, AFTER_S = 15.0, 2.0, 6.0
RETURNS_S = (1.0, 4.0, 7.0)  # what it sees then, one run each


def carried_away(to_s, folder):
    """redkitchen's first seconds, black images, and its images from `to_s` on, in one time; the same of the truth. The
    time from which on it sees again."""
    source = DATA / 'redkitchen'
    (folder / 'rgb').mkdir(parents=True)
    back_s = BEFORE_S + BLACK_S
    pictures = [line.split() for line in open(source / 'rgb.txt') if line.strip() and not line.startswith('#')]
    truth = [line.split() for line in open(source / 'reference_sfm.txt') if line.strip() and not line.startswith('#')]

    def cut(rows):
        for time, *rest in rows:
            if float(time) < BEFORE_S:
                yield float(time), rest
        for time, *rest in rows:
            if to_s <= float(time) < to_s + AFTER_S:
                yield float(time) - to_s + back_s, rest

    dark = folder / 'rgb' / 'dark.png'
    Image.fromarray(np.zeros_like(np.array(Image.open(source / pictures[0][1])))).save(dark)
    lines = []
    for time, (name,) in cut(pictures):
        if time >= back_s and not lines[-1].endswith('dark.png') and float(lines[-1].split()[0]) < BEFORE_S:
            lines += [f'{t:.6f} rgb/dark.png' for t in np.arange(BEFORE_S, back_s - 0.02, 1 / 30)]
        target = folder / 'rgb' / f'{time:.6f}.jpg'
        target.symlink_to((source / name).resolve())
        lines.append(f'{time:.6f} rgb/{target.name}')
    (folder / 'rgb.txt').write_text('\n'.join(lines) + '\n')
    (folder / 'truth.txt').write_text('\n'.join(' '.join([f'{time:.6f}', *rest]) for time, rest in cut(truth)) + '\n')
    return back_s


class Robustness:
    def carried_away(self, mode='--deterministic'):
        """Images after the black ones until one has a pose in the map, and all poses at the end."""
        def run(to_s):
            name = f'carried_to_{to_s:g}{mode}'
            folder, frames, live = self.path(name), self.path(f'{name}.txt'), self.path(f'{name}_live.txt')
            back_s = carried_away(to_s, folder)
            report = cairn('run', folder, '--camera', DATA / 'redkitchen' / 'camera.yaml', mode, '--map',
                           self.path(f'{name}.cairn'), '--trajectory', frames, '--live-poses', live, '--overwrite')
            ate = cairn('eval', 'ate', frames, folder / 'truth.txt', '--max-dt', 0.005)
            seen = [t for t in (float(line.split()[0]) for line in open(folder / 'rgb.txt')) if t >= back_s - 0.01]
            poses = [t for t in read_positions(live)[:, 0] if t >= back_s - 0.01]
            posed = [t for t in read_positions(frames)[:, 0] if t >= back_s - 0.01]
            return {'until': sum(t < poses[0] - 1e-4 for t in seen) if poses else len(seen), 'ate': ate['ate_m'],
                    'posed': len(posed) / len(seen), 'recoveries': report['recoveries'], 'segments': report['segments']}

        def one():
            results = [run(to_s) for to_s in RETURNS_S]
            print(f'        carried away {mode}: {results}', flush=True)
            return {'until': max(r['until'] for r in results), 'ate': max(r['ate'] for r in results),
                    'posed': min(r['posed'] for r in results)}
        return self.once(f'carried away {mode}', one)

    def long_gap(self, gap_s, at_s, mapped=False):
        """ATE of redkitchen without `gap_s` of its images (30 a second), until some seconds after: of the longest piece."""
        def one():
            name = f'without_{gap_s:g}_{at_s:g}{"_map" if mapped else ""}'
            spoil('gap', at_s, self.path(name), at_s + gap_s + AFTER_GAP_S, round(30 * gap_s))
            frames = self.path(f'{name}.txt')
            what = ['--map', self.path(f'{name}.cairn')] if mapped else ['--odometry-only']
            cairn('run', self.path(name), '--camera', DATA / 'redkitchen' / 'camera.yaml', *what, '--deterministic',
                  '--trajectory', frames, '--overwrite')
            return cairn('eval', 'ate', frames, DATA / 'redkitchen' / 'reference_sfm.txt', '--max-dt', 0.005)['ate_m']
        return self.once(f'long gap {gap_s} {at_s} {mapped}', one)

    def long_gaps(self, mapped):
        """How many of the gaps bend the trajectory, and the worst error: by the odometry alone, or with the map."""
        def one():
            errors = {(gap_s, at_s): self.long_gap(gap_s, at_s, mapped) for gap_s in GAPS_S for at_s in GAP_TIMES_S}
            print(f'        gaps, {"with the map" if mapped else "odometry alone"}:',
                  {key: round(error, 4) for key, error in errors.items()}, flush=True)
            return {'bent': sum(error > 0.03 for error in errors.values()), 'worst': max(errors.values())}
        return self.once(f'long gaps {mapped}', one)

    def damaged(self, kind, until_s=15.0):
        """The odometry alone: error against that of the same images unspoiled, and how many spoiled images have a pose."""
        def run(kind, at_s):
            name = f'spoiled_{kind.replace(" ", "_") or "none"}_{at_s:g}'
            times = spoil(kind, at_s, self.path(name), until_s)
            frames = self.path(f'{name}.txt')
            report = cairn('run', self.path(name), '--camera', DATA / 'redkitchen' / 'camera.yaml', '--odometry-only',
                           '--deterministic', '--trajectory', frames, '--overwrite')
            ate = cairn('eval', 'ate', frames, DATA / 'redkitchen' / 'reference_sfm.txt', '--max-dt', 0.005)['ate_m']
            answered = set(np.round(read_positions(frames)[:, 0], 4))
            return {'ate': ate, 'tracked': report['tracked_share'], 'segments': report['segments'],
                    'answered': sum(round(time, 4) in answered for time in times)}

        def one():
            plain = self.once('unspoiled', lambda: run('', 0.0))
            results = [run(kind, at_s) for at_s in (TIMES_S if kind in FRAMES else COVERED_TIMES_S)]
            print(f'        {kind}: {results}, unspoiled {plain["ate"]:.4f}', flush=True)
            return {'ratio': statistics.median(r['ate'] for r in results) / plain['ate'],
                    'worst': max(r['ate'] for r in results), 'answered': max(r['answered'] for r in results),
                    'tracked': min(r['tracked'] for r in results)}
        return self.once(f'damaged {kind}', one)
