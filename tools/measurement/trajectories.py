"""Trajectories and poses as text files: reading, comparing, carrying over to another camera."""
import math
import re

import numpy as np


def read_times(path):
    return [float(line.split()[0]) for line in open(path) if line.strip() and not line.startswith('#')]


def read_positions(path):
    rows = [line.split() for line in open(path) if line.strip() and not line.startswith('#')]
    return np.array([[float(x) for x in row[:4]] for row in rows])


def read_poses(path):
    """Times and world_from_camera, 4x4."""
    poses = []
    for row in (line.split() for line in open(path) if line.strip() and not line.startswith('#')):
        time, x, y, z, qx, qy, qz, qw = map(float, row[:8])
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = matrix_from_quaternion(qx, qy, qz, qw), (x, y, z)
        poses.append((time, pose))
    return poses


def write_poses(path, poses):
    path.write_text(''.join(' '.join([f'{time:.9f}', *(f'{v:.9f}' for v in [*pose[:3, 3], *quaternion_from_matrix(pose[:3, :3])])])
                            + '\n' for time, pose in poses))


def similarity(a, b):
    """Scale, rotation, translation of the least-squares similarity from points b to points a (Umeyama 1991)."""
    center_a, center_b = a.mean(axis=0), b.mean(axis=0)
    u, d, vt = np.linalg.svd((a - center_a).T @ (b - center_b))
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    rotation = u @ np.diag(sign) @ vt
    scale = (d * sign).sum() / ((b - center_b) ** 2).sum()
    return scale, rotation, center_a - scale * rotation @ center_b


def apply_similarity(transform, points):
    scale, rotation, translation = transform
    return scale * points @ rotation.T + translation


def mean_rotation(matrices):
    """The rotation nearest to all of them in the Frobenius norm."""
    u, _, vt = np.linalg.svd(np.sum(matrices, axis=0))
    return u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt


def angle_deg(rotation):
    return math.degrees(math.acos(min(1.0, max(-1.0, (np.trace(rotation) - 1.0) / 2.0))))


def scale_drift(frames, truth, share=0.12):
    """How much the scale of the last part of a trajectory differs from that of the first part: |ratio - 1|."""
    estimated, true = read_positions(frames), read_positions(truth)
    nearest = np.abs(true[:, 0][None, :] - estimated[:, 0][:, None]).argmin(axis=1)
    count = int(share * len(estimated))
    first, last = (similarity(true[nearest[part], 1:], estimated[part, 1:])[0]
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
