-- Format 4: components with frames of their own, changes that can be followed, a log that is known by its writer.
-- docs/map-format.md explains every column. The rows that there are get their new values from the software
-- (src/store/format_upgrade.cc), in the same transaction.
--
-- Columns named `revision`: of the last change that put the row.

DROP VIEW keyframe_positions;
DROP VIEW point_positions;
DROP VIEW session_summary;
DROP VIEW overview;

-- Every keyframe is in one component, whose frame its poses and points are given in.
CREATE TABLE components (
  id INTEGER PRIMARY KEY CHECK (id BETWEEN 1 AND 4294967295),
  session INTEGER REFERENCES sessions (id) DEFERRABLE INITIALLY DEFERRED,
  world_from_component_scale CHECK (typeof(world_from_component_scale) IN ('real', 'null')),
  world_from_component_qx, world_from_component_qy, world_from_component_qz, world_from_component_qw,
  world_from_component_tx, world_from_component_ty, world_from_component_tz,
  -- How it became part of another one; all NULL while it has not.
  joined_into INTEGER REFERENCES components (id) DEFERRABLE INITIALLY DEFERRED,
  into_from_component_scale,
  into_from_component_qx, into_from_component_qy, into_from_component_qz, into_from_component_qw,
  into_from_component_tx, into_from_component_ty, into_from_component_tz,
  joined_keyframe INTEGER,
  joined_into_keyframe INTEGER,
  joined_keyframe_time_ns INTEGER,
  joined_matches INTEGER,
  joined_keyframes_agreeing INTEGER,
  joined_keyframes_checked INTEGER,
  joined_revision INTEGER,
  joined_unix_ns INTEGER,
  revision INTEGER NOT NULL,
  row_checksum INTEGER NOT NULL
);

ALTER TABLE map DROP COLUMN world_from_map_scale;
ALTER TABLE map DROP COLUMN world_from_map_qx;
ALTER TABLE map DROP COLUMN world_from_map_qy;
ALTER TABLE map DROP COLUMN world_from_map_qz;
ALTER TABLE map DROP COLUMN world_from_map_qw;
ALTER TABLE map DROP COLUMN world_from_map_tx;
ALTER TABLE map DROP COLUMN world_from_map_ty;
ALTER TABLE map DROP COLUMN world_from_map_tz;
ALTER TABLE map ADD COLUMN log_token TEXT NOT NULL DEFAULT '';
ALTER TABLE map ADD COLUMN previous_log_token TEXT NOT NULL DEFAULT '';
ALTER TABLE map ADD COLUMN log_schema_cookie INTEGER NOT NULL DEFAULT 0;
ALTER TABLE map ADD COLUMN next_camera INTEGER NOT NULL DEFAULT 1;
ALTER TABLE map ADD COLUMN next_session INTEGER NOT NULL DEFAULT 1;
ALTER TABLE map ADD COLUMN next_component INTEGER NOT NULL DEFAULT 1;
ALTER TABLE map ADD COLUMN geo_latitude_deg;
ALTER TABLE map ADD COLUMN geo_longitude_deg;
ALTER TABLE map ADD COLUMN geo_height_m;
ALTER TABLE map ADD COLUMN geo_enu_from_world_qx;
ALTER TABLE map ADD COLUMN geo_enu_from_world_qy;
ALTER TABLE map ADD COLUMN geo_enu_from_world_qz;
ALTER TABLE map ADD COLUMN geo_enu_from_world_qw;
ALTER TABLE map ADD COLUMN info_revision INTEGER NOT NULL DEFAULT 0;
ALTER TABLE map ADD COLUMN oldest_delta_base INTEGER NOT NULL DEFAULT 0;

ALTER TABLE cameras ADD COLUMN revision INTEGER NOT NULL DEFAULT 0;

ALTER TABLE sessions ADD COLUMN removed INTEGER NOT NULL DEFAULT 0 CHECK (removed IN (0, 1));
ALTER TABLE sessions ADD COLUMN policy TEXT NOT NULL DEFAULT 'create';
ALTER TABLE sessions ADD COLUMN result TEXT NOT NULL DEFAULT 'unknown';
ALTER TABLE sessions ADD COLUMN components TEXT NOT NULL DEFAULT '';
ALTER TABLE sessions ADD COLUMN revision INTEGER NOT NULL DEFAULT 0;

ALTER TABLE keyframes ADD COLUMN component INTEGER NOT NULL DEFAULT 0
  REFERENCES components (id) DEFERRABLE INITIALLY DEFERRED;
ALTER TABLE keyframes ADD COLUMN revision INTEGER NOT NULL DEFAULT 0;

-- Of the last change of these blobs.
ALTER TABLE keyframe_features ADD COLUMN revision INTEGER NOT NULL DEFAULT 0;
ALTER TABLE keyframe_points ADD COLUMN revision INTEGER NOT NULL DEFAULT 0;

ALTER TABLE points ADD COLUMN revision INTEGER NOT NULL DEFAULT 0;

ALTER TABLE changes ADD COLUMN session INTEGER;
ALTER TABLE changes ADD COLUMN components TEXT NOT NULL DEFAULT '';
ALTER TABLE changes ADD COLUMN cameras_put INTEGER NOT NULL DEFAULT 0;
ALTER TABLE changes ADD COLUMN cameras_removed INTEGER NOT NULL DEFAULT 0;
ALTER TABLE changes ADD COLUMN sessions_put INTEGER NOT NULL DEFAULT 0;
ALTER TABLE changes ADD COLUMN components_put INTEGER NOT NULL DEFAULT 0;
ALTER TABLE changes ADD COLUMN components_removed INTEGER NOT NULL DEFAULT 0;
ALTER TABLE changes ADD COLUMN info_put INTEGER NOT NULL DEFAULT 0;

-- Which rows each of the newest changes put or removed: what is named here and has no row was removed.
CREATE TABLE touched (
  revision INTEGER NOT NULL,
  kind TEXT NOT NULL CHECK (kind IN ('cameras', 'sessions', 'components', 'keyframes', 'points')),
  ids_checksum INTEGER NOT NULL,
  ids BLOB NOT NULL,
  PRIMARY KEY (revision, kind)
) WITHOUT ROWID;

-- For people at the sqlite3 prompt. Cairn itself does not read these.

CREATE VIEW keyframe_positions AS
-- The centre of a camera is -R' t: t turned by the conjugate quaternion, t + 2 u x (u x t) - 2 w (u x t), negated.
WITH crossed AS (
  SELECT id, session, camera, component, time_ns,
         camera_from_map_qx AS ux, camera_from_map_qy AS uy, camera_from_map_qz AS uz, camera_from_map_qw AS w,
         camera_from_map_tx AS tx, camera_from_map_ty AS ty, camera_from_map_tz AS tz,
         camera_from_map_qy * camera_from_map_tz - camera_from_map_qz * camera_from_map_ty AS cx,
         camera_from_map_qz * camera_from_map_tx - camera_from_map_qx * camera_from_map_tz AS cy,
         camera_from_map_qx * camera_from_map_ty - camera_from_map_qy * camera_from_map_tx AS cz
  FROM keyframes
), centers AS (
  SELECT id, session, camera, component, time_ns,
         -(tx + 2 * (uy * cz - uz * cy) - 2 * w * cx) AS map_x,
         -(ty + 2 * (uz * cx - ux * cz) - 2 * w * cy) AS map_y,
         -(tz + 2 * (ux * cy - uy * cx) - 2 * w * cz) AS map_z
  FROM crossed
), turned AS (
  SELECT centers.*, world_from_component_scale AS s,
         world_from_component_qx AS ux, world_from_component_qy AS uy, world_from_component_qz AS uz,
         world_from_component_qw AS w,
         world_from_component_tx AS tx, world_from_component_ty AS ty, world_from_component_tz AS tz,
         world_from_component_qy * map_z - world_from_component_qz * map_y AS cx,
         world_from_component_qz * map_x - world_from_component_qx * map_z AS cy,
         world_from_component_qx * map_y - world_from_component_qy * map_x AS cz
  FROM centers JOIN components ON components.id = centers.component
)
SELECT id AS keyframe, session, camera, component, time_ns / 1e9 AS time_s, map_x, map_y, map_z,
       s * (map_x + 2 * w * cx + 2 * (uy * cz - uz * cy)) + tx AS world_x_m,
       s * (map_y + 2 * w * cy + 2 * (uz * cx - ux * cz)) + ty AS world_y_m,
       s * (map_z + 2 * w * cz + 2 * (ux * cy - uy * cx)) + tz AS world_z_m
FROM turned;

CREATE VIEW point_positions AS
WITH turned AS (
  SELECT points.id, keyframes.component, x, y, z, times_visible, times_found, reference_keyframe,
         world_from_component_scale AS s,
         world_from_component_qx AS ux, world_from_component_qy AS uy, world_from_component_qz AS uz,
         world_from_component_qw AS w,
         world_from_component_tx AS tx, world_from_component_ty AS ty, world_from_component_tz AS tz,
         world_from_component_qy * z - world_from_component_qz * y AS cx,
         world_from_component_qz * x - world_from_component_qx * z AS cy,
         world_from_component_qx * y - world_from_component_qy * x AS cz
  FROM points JOIN keyframes ON keyframes.id = points.reference_keyframe
       JOIN components ON components.id = keyframes.component
)
SELECT id AS point, component, x AS map_x, y AS map_y, z AS map_z,
       s * (x + 2 * w * cx + 2 * (uy * cz - uz * cy)) + tx AS world_x_m,
       s * (y + 2 * w * cy + 2 * (uz * cx - ux * cz)) + ty AS world_y_m,
       s * (z + 2 * w * cz + 2 * (ux * cy - uy * cx)) + tz AS world_z_m,
       reference_keyframe, times_visible, times_found
FROM turned;

CREATE VIEW session_summary AS
SELECT sessions.id AS session, cameras.name AS camera, source, policy, result, sessions.components, complete, removed,
       (last_ns - first_ns) / 1e9 AS duration_s,
       (SELECT count(*) FROM keyframes WHERE keyframes.session = sessions.id) AS keyframes,
       (SELECT count(*) FROM points JOIN keyframes ON keyframes.id = points.reference_keyframe
        WHERE keyframes.session = sessions.id) AS points,
       datetime(nullif(started_unix_ns, 0) / 1000000000, 'unixepoch') AS started_utc
FROM sessions JOIN cameras ON cameras.id = sessions.camera;

CREATE VIEW component_summary AS
SELECT id AS component, session AS begun_by_session, joined_into, joined_revision,
       (SELECT count(*) FROM keyframes WHERE keyframes.component = components.id) AS keyframes,
       world_from_component_scale IS NOT NULL AS aligned
FROM components;

CREATE VIEW overview AS
SELECT name, map_id, revision, keyframe_count AS keyframes, point_count AS points,
       (SELECT count(*) FROM sessions) AS sessions, (SELECT count(*) FROM cameras) AS cameras,
       (SELECT count(*) FROM components WHERE joined_into IS NULL) AS components,
       (SELECT count(*) FROM components WHERE joined_into IS NULL AND world_from_component_scale IS NOT NULL) AS aligned,
       datetime(nullif(created_unix_ns, 0) / 1000000000, 'unixepoch') AS created_utc
FROM map;
