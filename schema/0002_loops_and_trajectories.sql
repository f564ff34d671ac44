-- Format 2: what a session found out about its own trajectory. docs/map-format.md explains every column.

-- Loops closed, in order. The keyframes may have been culled since.
CREATE TABLE loops (
  session INTEGER NOT NULL REFERENCES sessions (id) DEFERRABLE INITIALLY DEFERRED,
  number INTEGER NOT NULL CHECK (number > 0),
  keyframe INTEGER NOT NULL,
  keyframe_time_ns INTEGER NOT NULL,
  loop_keyframe INTEGER NOT NULL,
  loop_time_ns INTEGER NOT NULL,
  matches INTEGER NOT NULL,
  scale NOT NULL,
  shift NOT NULL,
  turn_rad NOT NULL,
  way NOT NULL,
  row_checksum INTEGER NOT NULL,
  PRIMARY KEY (session, number)
) WITHOUT ROWID;

-- Which of its two trajectories a complete session reported, and why.
CREATE TABLE reported_trajectories (
  session INTEGER PRIMARY KEY REFERENCES sessions (id) DEFERRABLE INITIALLY DEFERRED,
  refined INTEGER NOT NULL CHECK (refined IN (0, 1)),
  keyframes INTEGER NOT NULL,
  collinear INTEGER NOT NULL,
  reason TEXT NOT NULL,
  row_checksum INTEGER NOT NULL
);
