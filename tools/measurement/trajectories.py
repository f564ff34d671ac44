"""Trajectories and poses as text files: reading, comparing, carrying over to another camera."""
import math
import re

import numpy as np


def read_times(path):
    return [float(line.split()[0]) for line in open(path) if line.strip() and not line.startswith('#')]


def read_positions(path):
    rows = [line.split() for line in open(path) if line.strip() and not line.startswith('#')]
    return np.array([[float(x) for x in row[:4]] for row in rows])


def similarity_scale(a, b):
    """Scale of the least-squares similarity from points b to points a (Umeyama 1991)."""
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    u, d, vt = np.linalg.svd(a.T @ b)
    d[-1] *= np.sign(np.linalg.det(u) * np.linalg.det(vt))
    return d.sum() / (b * b).sum()


def scale_drift(frames, truth, share=0.12):
    """How much the scale of the last part of a trajectory differs from that of the first part: |ratio - 1|."""
    estimated, true = read_positions(frames), read_positions(truth)
    nearest = np.abs(true[:, 0][None, :] - estimated[:, 0][:, None]).argmin(axis=1)
    count = int(share * len(estimated))
    first, last = (similarity_scale(true[nearest[part], 1:], estimated[part, 1:])
                   for part in (slice(0, count), slice(len(estimated) - count, None)))
    return abs(last / first - 1.0)


def white_noise(positions):
    """What of positions at even times is uncorrelated noise, RMS: by third differences, of which a smooth motion has next
    to none and white noise sqrt(1 + 9 + 9 + 1) times its own."""
    third = np.diff(positions, n=3, axis=0)
    return float(np.sqrt((third ** 2).sum(axis=1).mean() / 20))


def distance_between(truth, *times):
    true = read_positions(truth)
    a, b = (true[np.abs(true[:, 0] - t).argmin(), 1:] for t in times)
    return float(np.linalg.norm(a - b))


def cam1_from_cam0(folder, cam0_truth, out):
    """Ground truth of the right camera from that of the left, by the extrinsics in both sensor.yaml."""
    def body_from_camera(name):
        text = (folder / 'mav0' / name / 'sensor.yaml').read_text()
        numbers = re.search(r'data:\s*\[([^\]]*)\]', text)[1]
        return np.array([float(x) for x in numbers.split(',')]).reshape(4, 4)

    cam0_from_cam1 = np.linalg.inv(body_from_camera('cam0')) @ body_from_camera('cam1')
    lines = []
    for line in open(cam0_truth):
        if line.startswith('#') or not line.strip():
            continue
        stamp, *numbers = line.split()
        x, y, z, qx, qy, qz, qw = map(float, numbers[:7])
        pose = np.eye(4)
        pose[:3, :3] = matrix_from_quaternion(qx, qy, qz, qw)
        pose[:3, 3] = x, y, z
        pose = pose @ cam0_from_cam1
        lines.append(' '.join([stamp, *(f'{v:.9f}' for v in [*pose[:3, 3], *quaternion_from_matrix(pose[:3, :3])])]))
    out.write_text('\n'.join(lines) + '\n')


def matrix_from_quaternion(x, y, z, w):
    n = math.sqrt(x * x + y * y + z * z + w * w)
    x, y, z, w = x / n, y / n, z / n, w / n
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])


def quaternion_from_matrix(r):
    # The eigenvector of the largest eigenvalue (Bar-Itzhack 2000): no special cases.
    k = np.array([[r[0, 0] - r[1, 1] - r[2, 2], 0, 0, 0],
                  [r[1, 0] + r[0, 1], r[1, 1] - r[0, 0] - r[2, 2], 0, 0],
                  [r[2, 0] + r[0, 2], r[2, 1] + r[1, 2], r[2, 2] - r[0, 0] - r[1, 1], 0],
                  [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], r[0, 0] + r[1, 1] + r[2, 2]]]) / 3
    return np.linalg.eigh(k)[1][:, -1]
