-- Format 1 of a Cairn map. docs/map-format.md explains every column; src/store is the only writer.
--
-- Transforms a_from_b take a point from frame b to frame a: rotation as unit quaternion qx qy qz qw, then translation tx ty tz.
-- Frame "map" is the map's own; frame "world" is metric and exists once the map has been aligned.
-- Floating-point columns have no declared type on purpose: SQLite would store -0.0 as 0 in a column of type REAL.
-- row_checksum: the low 32 bits of the xxHash64 of the other columns. *_checksum: the xxHash64 of that blob.

CREATE TABLE map (
  id INTEGER PRIMARY KEY CHECK (id = 1),
  map_id TEXT NOT NULL,
  name TEXT NOT NULL,
  software_version TEXT NOT NULL,
  created_unix_ns INTEGER NOT NULL,
  orb_num_features INTEGER NOT NULL,
  orb_num_levels INTEGER NOT NULL,
  orb_scale_factor NOT NULL CHECK (typeof(orb_scale_factor) = 'real'),
  orb_fast_threshold INTEGER NOT NULL,
  orb_min_fast_threshold INTEGER NOT NULL,
  vocabulary_hash TEXT,
  world_from_map_scale CHECK (typeof(world_from_map_scale) IN ('real', 'null')),
  world_from_map_qx, world_from_map_qy, world_from_map_qz, world_from_map_qw,
  world_from_map_tx, world_from_map_ty, world_from_map_tz,
  revision INTEGER NOT NULL CHECK (revision >= 0),
  next_keyframe INTEGER NOT NULL,
  next_point INTEGER NOT NULL,
  keyframe_count INTEGER NOT NULL,
  point_count INTEGER NOT NULL,
  covisibility_count INTEGER NOT NULL,
  row_checksum INTEGER NOT NULL
);

CREATE TABLE cameras (
  id INTEGER PRIMARY KEY CHECK (id BETWEEN 1 AND 4294967295),
  name TEXT NOT NULL,
  model TEXT NOT NULL,
  width_px INTEGER NOT NULL,
  height_px INTEGER NOT NULL,
  fx_px NOT NULL, fy_px NOT NULL, cx_px NOT NULL, cy_px NOT NULL,
  distortion BLOB NOT NULL,
  pinhole_width_px INTEGER NOT NULL,
  pinhole_height_px INTEGER NOT NULL,
  pinhole_fx_px NOT NULL, pinhole_fy_px NOT NULL, pinhole_cx_px NOT NULL, pinhole_cy_px NOT NULL,
  row_checksum INTEGER NOT NULL
);

CREATE TABLE sessions (
  id INTEGER PRIMARY KEY CHECK (id BETWEEN 1 AND 4294967295),
  camera INTEGER NOT NULL REFERENCES cameras (id),
  source TEXT NOT NULL,
  software_version TEXT NOT NULL,
  settings_json TEXT NOT NULL,
  first_ns INTEGER NOT NULL,
  last_ns INTEGER NOT NULL,
  started_unix_ns INTEGER NOT NULL,
  ended_unix_ns INTEGER NOT NULL,
  complete INTEGER NOT NULL CHECK (complete IN (0, 1)),
  row_checksum INTEGER NOT NULL
);

CREATE TABLE keyframes (
  id INTEGER PRIMARY KEY CHECK (id BETWEEN 1 AND 4294967295),
  session INTEGER NOT NULL REFERENCES sessions (id),
  camera INTEGER NOT NULL REFERENCES cameras (id),
  time_ns INTEGER NOT NULL,
  frame_index INTEGER NOT NULL,
  camera_from_map_qx NOT NULL, camera_from_map_qy NOT NULL, camera_from_map_qz NOT NULL, camera_from_map_qw NOT NULL,
  camera_from_map_tx NOT NULL, camera_from_map_ty NOT NULL, camera_from_map_tz NOT NULL,
  camera_from_direct_qx NOT NULL, camera_from_direct_qy NOT NULL, camera_from_direct_qz NOT NULL,
  camera_from_direct_qw NOT NULL,
  camera_from_direct_tx NOT NULL, camera_from_direct_ty NOT NULL, camera_from_direct_tz NOT NULL,
  direct_segment INTEGER NOT NULL,
  parent INTEGER REFERENCES keyframes (id) DEFERRABLE INITIALLY DEFERRED,
  row_checksum INTEGER NOT NULL
);
CREATE INDEX keyframes_by_parent ON keyframes (parent);

-- What never changes once a keyframe exists.
CREATE TABLE keyframe_features (
  keyframe INTEGER PRIMARY KEY REFERENCES keyframes (id) DEFERRABLE INITIALLY DEFERRED,
  feature_count INTEGER NOT NULL,
  keypoint_layout INTEGER NOT NULL CHECK (keypoint_layout IN (0, 1)),
  word_bytes INTEGER NOT NULL CHECK (word_bytes BETWEEN 0 AND 4),
  keypoints_checksum INTEGER NOT NULL,
  descriptors_checksum INTEGER NOT NULL,
  words_checksum INTEGER NOT NULL,
  keypoints BLOB NOT NULL,
  descriptors BLOB NOT NULL,
  words BLOB NOT NULL
);

-- Which point each feature observes.
CREATE TABLE keyframe_points (
  keyframe INTEGER PRIMARY KEY REFERENCES keyframes (id) DEFERRABLE INITIALLY DEFERRED,
  point_ids_checksum INTEGER NOT NULL,
  point_ids BLOB NOT NULL
);

CREATE TABLE points (
  id INTEGER PRIMARY KEY CHECK (id BETWEEN 1 AND 4294967295),
  x NOT NULL CHECK (typeof(x) = 'real'),
  y NOT NULL CHECK (typeof(y) = 'real'),
  z NOT NULL CHECK (typeof(z) = 'real'),
  reference_keyframe INTEGER NOT NULL,
  times_visible INTEGER NOT NULL,
  times_found INTEGER NOT NULL,
  row_checksum INTEGER NOT NULL
);

CREATE TABLE covisibility (
  keyframe_a INTEGER NOT NULL REFERENCES keyframes (id) DEFERRABLE INITIALLY DEFERRED,
  keyframe_b INTEGER NOT NULL REFERENCES keyframes (id) DEFERRABLE INITIALLY DEFERRED,
  shared_points INTEGER NOT NULL CHECK (shared_points > 0),
  row_checksum INTEGER NOT NULL,
  PRIMARY KEY (keyframe_a, keyframe_b),
  CHECK (keyframe_a < keyframe_b)
) WITHOUT ROWID;
CREATE INDEX covisibility_by_b ON covisibility (keyframe_b);

CREATE TABLE vocabulary (
  id INTEGER PRIMARY KEY CHECK (id = 1),
  bytes_checksum INTEGER NOT NULL,
  bytes BLOB NOT NULL
);

-- The newest changes; older ones are dropped.
CREATE TABLE changes (
  revision INTEGER PRIMARY KEY,
  reason TEXT NOT NULL,
  committed_unix_ns INTEGER NOT NULL,
  keyframes_put INTEGER NOT NULL,
  keyframes_removed INTEGER NOT NULL,
  points_put INTEGER NOT NULL,
  points_removed INTEGER NOT NULL,
  row_checksum INTEGER NOT NULL
);

-- For people at the sqlite3 prompt. Cairn itself does not read these.

CREATE VIEW keyframe_positions AS
-- The centre of a camera is -R' t: t turned by the conjugate quaternion, t + 2 u x (u x t) - 2 w (u x t), negated.
WITH crossed AS (
  SELECT id, session, camera, time_ns,
         camera_from_map_qx AS ux, camera_from_map_qy AS uy, camera_from_map_qz AS uz, camera_from_map_qw AS w,
         camera_from_map_tx AS tx, camera_from_map_ty AS ty, camera_from_map_tz AS tz,
         camera_from_map_qy * camera_from_map_tz - camera_from_map_qz * camera_from_map_ty AS cx,
         camera_from_map_qz * camera_from_map_tx - camera_from_map_qx * camera_from_map_tz AS cy,
         camera_from_map_qx * camera_from_map_ty - camera_from_map_qy * camera_from_map_tx AS cz
  FROM keyframes
), centers AS (
  SELECT id, session, camera, time_ns,
         -(tx + 2 * (uy * cz - uz * cy) - 2 * w * cx) AS map_x,
         -(ty + 2 * (uz * cx - ux * cz) - 2 * w * cy) AS map_y,
         -(tz + 2 * (ux * cy - uy * cx) - 2 * w * cz) AS map_z
  FROM crossed
), turned AS (
  SELECT centers.*, world_from_map_scale AS s,
         world_from_map_qx AS ux, world_from_map_qy AS uy, world_from_map_qz AS uz, world_from_map_qw AS w,
         world_from_map_tx AS tx, world_from_map_ty AS ty, world_from_map_tz AS tz,
         world_from_map_qy * map_z - world_from_map_qz * map_y AS cx,
         world_from_map_qz * map_x - world_from_map_qx * map_z AS cy,
         world_from_map_qx * map_y - world_from_map_qy * map_x AS cz
  FROM centers, map
)
SELECT id AS keyframe, session, camera, time_ns / 1e9 AS time_s, map_x, map_y, map_z,
       s * (map_x + 2 * w * cx + 2 * (uy * cz - uz * cy)) + tx AS world_x_m,
       s * (map_y + 2 * w * cy + 2 * (uz * cx - ux * cz)) + ty AS world_y_m,
       s * (map_z + 2 * w * cz + 2 * (ux * cy - uy * cx)) + tz AS world_z_m
FROM turned;

CREATE VIEW point_positions AS
WITH turned AS (
  SELECT points.id, x, y, z, times_visible, times_found, reference_keyframe, world_from_map_scale AS s,
         world_from_map_qx AS ux, world_from_map_qy AS uy, world_from_map_qz AS uz, world_from_map_qw AS w,
         world_from_map_tx AS tx, world_from_map_ty AS ty, world_from_map_tz AS tz,
         world_from_map_qy * z - world_from_map_qz * y AS cx,
         world_from_map_qz * x - world_from_map_qx * z AS cy,
         world_from_map_qx * y - world_from_map_qy * x AS cz
  FROM points, map
)
SELECT id AS point, x AS map_x, y AS map_y, z AS map_z,
       s * (x + 2 * w * cx + 2 * (uy * cz - uz * cy)) + tx AS world_x_m,
       s * (y + 2 * w * cy + 2 * (uz * cx - ux * cz)) + ty AS world_y_m,
       s * (z + 2 * w * cz + 2 * (ux * cy - uy * cx)) + tz AS world_z_m,
       reference_keyframe, times_visible, times_found
FROM turned;

CREATE VIEW session_summary AS
SELECT sessions.id AS session, cameras.name AS camera, source, complete,
       (last_ns - first_ns) / 1e9 AS duration_s,
       (SELECT count(*) FROM keyframes WHERE keyframes.session = sessions.id) AS keyframes,
       (SELECT count(*) FROM points JOIN keyframes ON keyframes.id = points.reference_keyframe
        WHERE keyframes.session = sessions.id) AS points,
       datetime(nullif(started_unix_ns, 0) / 1000000000, 'unixepoch') AS started_utc
FROM sessions JOIN cameras ON cameras.id = sessions.camera;

CREATE VIEW keyframe_neighbours AS
SELECT keyframe_a AS keyframe, keyframe_b AS neighbour, shared_points FROM covisibility
UNION ALL
SELECT keyframe_b, keyframe_a, shared_points FROM covisibility;

CREATE VIEW overview AS
SELECT name, map_id, revision, keyframe_count AS keyframes, point_count AS points,
       (SELECT count(*) FROM sessions) AS sessions, (SELECT count(*) FROM cameras) AS cameras,
       world_from_map_scale IS NOT NULL AS aligned,
       datetime(nullif(created_unix_ns, 0) / 1000000000, 'unixepoch') AS created_utc
FROM map;
