-- Views for people at the prompt, beyond those that every map has (docs/map-format.md, "Views"). They are TEMP: nothing
-- is written to the map.
--
--     sqlite3 -readonly -init share/cairn/schema/views/inspection.sql office.cairn 'SELECT * FROM session_overlaps'

-- What a keyframe's features take in the file.
CREATE TEMP VIEW keyframe_bytes AS
SELECT keyframe, feature_count AS features, length(keypoints) AS keypoint_bytes, length(descriptors) AS descriptor_bytes,
       length(words) AS word_bytes, length(point_ids) AS link_bytes
FROM keyframe_features JOIN keyframe_points USING (keyframe);

-- How well a keyframe hangs together with others: neighbours that share 15 points and more, and the most shared.
CREATE TEMP VIEW keyframe_links AS
SELECT keyframes.id AS keyframe, session, component,
       count(CASE WHEN shared_points >= 15 THEN 1 END) AS neighbours, coalesce(max(shared_points), 0) AS most_shared
FROM keyframes LEFT JOIN keyframe_neighbours ON keyframe_neighbours.keyframe = keyframes.id
GROUP BY keyframes.id;

-- Keyframes that hang on one neighbour, or on none: where a map may break when they go.
CREATE TEMP VIEW weak_keyframes AS SELECT * FROM keyframe_links WHERE neighbours < 2;

-- Points by how often they are found where they should be seen.
CREATE TEMP VIEW point_quality AS
SELECT points.id AS point, keyframes.session, keyframes.component, times_visible, times_found,
       1.0 * times_found / times_visible AS found_share
FROM points JOIN keyframes ON keyframes.id = reference_keyframe;

-- What a session has in each component.
CREATE TEMP VIEW session_shares AS
SELECT session, component, count(*) AS keyframes, min(time_ns) / 1e9 AS first_s, max(time_ns) / 1e9 AS last_s
FROM keyframes GROUP BY session, component;

-- Which sessions saw the same: pairs of keyframes of theirs with common points, and the most that one pair shares.
CREATE TEMP VIEW session_overlaps AS
SELECT min(a.session, b.session) AS session, max(a.session, b.session) AS other, count(*) AS keyframe_pairs,
       max(shared_points) AS most_shared
FROM covisibility JOIN keyframes AS a ON a.id = keyframe_a JOIN keyframes AS b ON b.id = keyframe_b
WHERE a.session <> b.session
GROUP BY 1, 2;

-- The log of changes by who made them.
CREATE TEMP VIEW change_totals AS
SELECT session, count(*) AS changes, sum(keyframes_put) AS keyframes_put, sum(keyframes_removed) AS keyframes_removed,
       sum(points_put) AS points_put, sum(points_removed) AS points_removed, min(revision) AS first_revision,
       max(revision) AS last_revision
FROM changes GROUP BY session;
