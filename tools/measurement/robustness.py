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
COVERED_TIMES_S = (4.0, 6.0, 8.0, 10.0, 12.0)


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


def spoil(kind, at_s, folder, until_s):
    """A copy of redkitchen with damage from `at_s` on; the times of the images that were spoiled or left out."""
    source = DATA / 'redkitchen'
    (folder / 'rgb').mkdir(parents=True)
    lines, times, count = [], [], FRAMES.get(kind, COVERED_FRAMES)
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


class Robustness:
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
