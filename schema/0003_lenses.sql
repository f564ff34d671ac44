-- Format 3: what a camera's calibration left over, as a session found out. docs/map-format.md explains every column.
-- The keypoints of such a camera's keyframes are where its pinhole would have seen them.
CREATE TABLE lenses (
  camera INTEGER PRIMARY KEY REFERENCES cameras (id) DEFERRABLE INITIALLY DEFERRED,
  focal_scale NOT NULL CHECK (typeof(focal_scale) = 'real'),
  k1 NOT NULL CHECK (typeof(k1) = 'real'),
  k2 NOT NULL CHECK (typeof(k2) = 'real'),
  row_checksum INTEGER NOT NULL
);
