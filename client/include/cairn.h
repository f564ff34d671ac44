/**
 * \file
 * Cairn's client library for C, and for languages that call C: what cairn/map.h is for C++.
 *
 *     cairn_error error = {sizeof error};
 *     cairn_map* map = NULL;
 *     if (cairn_map_open("office.cairn", NULL, NULL, &map, &error) != CAIRN_OK) return fail(error.message);
 *
 * Handles are opaque; who is given one closes it. A function that can fail returns a code, and says in `error`, if that
 * is not null, what was wrong, where, and what to do; on failure it changes no output. Nothing ends the process.
 *
 * Structs begin with struct_size, which the caller sets to sizeof: they can grow, and programs compiled before go on
 * working. In those that are handed in, zero is the default of every member, so that `cairn_image image = {sizeof
 * image}` is complete but for what has to be said. Strings are UTF-8, end with a zero, and are cut where they do not
 * fit.
 *
 * Frames, units and threads are those of the C++ headers: maps and localizers are thread-safe; calls of one tracker are
 * made one after the other. A handle must not be closed while it is used; a map may be closed before its localizers and
 * trackers.
 */
#ifndef CAIRN_H_
#define CAIRN_H_

#include <stddef.h>
#include <stdint.h>

#include "cairn/version.h"

#if defined(__GNUC__)
#define CAIRN_C_API __attribute__((visibility("default"))) /**< Marks what is exported. */
#else
#define CAIRN_C_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

typedef struct cairn_map cairn_map;                   /**< A map that is only read. */
typedef struct cairn_localizer cairn_localizer;       /**< Finds single images. */
typedef struct cairn_tracker cairn_tracker;           /**< Follows a stream of images. */
typedef struct cairn_cancellation cairn_cancellation; /**< Ends calls from another thread. */

/** What came of a call, one of the cairn_codes: those of absl::StatusCode (cairn/status.h says when). */
typedef int32_t cairn_code;

/** The values of cairn_code. */
enum cairn_codes {
  CAIRN_OK = 0,        /**< done */
  CAIRN_CANCELLED = 1, /**< by the caller's cairn_cancellation */
  CAIRN_UNKNOWN = 2,   /**< something else */
  CAIRN_INVALID_ARGUMENT =
      3, /**< an image, camera, time, struct or option that makes no sense; a file that is no map */
  CAIRN_DEADLINE_EXCEEDED = 4,   /**< not done in time */
  CAIRN_NOT_FOUND = 5,           /**< there is no such map */
  CAIRN_ALREADY_EXISTS = 6,      /**< not used yet */
  CAIRN_PERMISSION_DENIED = 7,   /**< the file cannot be read */
  CAIRN_RESOURCE_EXHAUSTED = 8,  /**< memory, threads or room on the disk ran out */
  CAIRN_FAILED_PRECONDITION = 9, /**< the map cannot be used so */
  CAIRN_ABORTED = 10,            /**< the map was removed, moved or replaced: open it again */
  CAIRN_OUT_OF_RANGE = 11,       /**< an index beyond the end */
  CAIRN_UNIMPLEMENTED = 12,      /**< the map is of a newer version; or not possible yet */
  CAIRN_INTERNAL = 13,           /**< the operating system or a library failed */
  CAIRN_UNAVAILABLE = 14,        /**< not now: try again */
  CAIRN_DATA_LOSS = 15,          /**< the map is damaged */
  CAIRN_UNAUTHENTICATED = 16     /**< not used yet */
};

/** What was wrong. */
typedef struct cairn_error {
  size_t struct_size; /**< sizeof(cairn_error) */
  cairn_code code;    /**< what the function returned */
  char message[1012]; /**< for people; empty after success */
} cairn_error;

/** How long a call may take; NULL instead of one: as long as it needs. cairn/call_options.h says how exact it is. */
typedef struct cairn_call_options {
  size_t struct_size;                     /**< sizeof(cairn_call_options) */
  int64_t timeout_ns;                     /**< from now; 0: as long as it needs */
  const cairn_cancellation* cancellation; /**< may be NULL; must live until the call returns */
} cairn_call_options;

/** How a map is opened; NULL instead of one: as usual. */
typedef struct cairn_map_options {
  size_t struct_size;   /**< sizeof(cairn_map_options) */
  int32_t num_features; /**< looked for in an image to be located; 0: as many as in the map's keyframes */
  int32_t reserved;     /**< 0 */
  /* How the server of a map is asked, of no account for a file. NULL or empty: as the environment says. */
  const char* token;            /**< that it asks for; CAIRN_TOKEN */
  const char* ca_file;          /**< PEM: the CA of its certificate, turns TLS on; CAIRN_CA */
  const char* certificate_file; /**< PEM: the certificate that it asks for; CAIRN_CERT */
  const char* key_file;         /**< PEM: its key; CAIRN_KEY */
  int32_t tls;                  /**< 1: TLS, with a certificate of a CA that this machine trusts; CAIRN_TLS=1 */
  int32_t token_in_clear;       /**< 1: send the token without TLS, also to other machines */
} cairn_map_options;

/** What a map is, in one revision. */
typedef struct cairn_map_info {
  size_t struct_size; /**< sizeof(cairn_map_info) */
  char id[40];        /**< 32 hex digits */
  char name[256];     /**< for people */
  uint64_t revision;  /**< every change adds one */
  int64_t keyframes;  /**< in all components */
  int64_t points;     /**< in all components */
  int32_t cameras;    /**< that made the map: cairn_map_camera() */
  int32_t components; /**< parts with a frame of their own: cairn_map_get_component() */
  int32_t aligned;    /**< of these, parts whose place in the world is known */
  int32_t reserved;   /**< 0 */
} cairn_map_info;

/** How a lens bends light (cairn/camera.h). */
enum cairn_camera_model {
  CAIRN_CAMERA_PINHOLE = 0,           /**< not at all */
  CAIRN_CAMERA_RADIAL_TANGENTIAL = 1, /**< k1 k2 p1 p2 [k3 [k4 k5 k6]] */
  CAIRN_CAMERA_KANNALA_BRANDT = 2,    /**< k1 k2 k3 k4 */
  CAIRN_CAMERA_FOV = 3                /**< omega, radians */
};

/** A calibration, in pixels of the raw image; pixel centres are at integer coordinates. */
typedef struct cairn_camera {
  size_t struct_size;     /**< sizeof(cairn_camera) */
  int32_t model;          /**< cairn_camera_model */
  int32_t width_px;       /**< of the images */
  int32_t height_px;      /**< of the images */
  int32_t num_distortion; /**< coefficients that count */
  double fx_px;           /**< focal length along a row */
  double fy_px;           /**< focal length along a column */
  double cx_px;           /**< column of the principal point */
  double cy_px;           /**< row of the principal point */
  double distortion[8];   /**< in the order of the model */
} cairn_camera;

/** How the bytes of a pixel follow each other. */
enum cairn_pixel_format {
  CAIRN_PIXELS_GRAY8 = 0, /**< one byte: brightness */
  CAIRN_PIXELS_RGB8 = 1,  /**< three bytes: red, green, blue */
  CAIRN_PIXELS_BGR8 = 2   /**< three bytes: blue, green, red */
};

/** Pixels that belong to the caller; nothing keeps them after the call. */
typedef struct cairn_image {
  size_t struct_size;   /**< sizeof(cairn_image) */
  const uint8_t* data;  /**< the first byte of the upper left pixel */
  int32_t width_px;     /**< pixels in a row */
  int32_t height_px;    /**< rows */
  int64_t stride_bytes; /**< from the start of a row to that of the next one; 0: no gap between rows */
  int32_t format;       /**< cairn_pixel_format */
  int32_t reserved;     /**< 0 */
} cairn_image;

/** A rigid transform a_from_b. It has no struct_size and stays as it is. */
typedef struct cairn_pose {
  double translation[3];   /**< in units of frame a */
  double rotation_xyzw[4]; /**< unit quaternion */
} cairn_pose;

/** Where the camera is thought to be (cairn/localizer.h). */
typedef struct cairn_prior {
  size_t struct_size;         /**< sizeof(cairn_prior) */
  cairn_pose map_from_camera; /**< in the frame of the component, or in that of the world */
  double position_sigma;      /**< per axis, greater than 0; infinite: unknown */
  double rotation_sigma_rad;  /**< per axis, greater than 0 */
  uint32_t component;         /**< 0: none */
  uint32_t reserved;          /**< 0 */
} cairn_prior;

/** One image, and the camera that took it: any camera, not only one that made the map. */
typedef struct cairn_localize_query {
  size_t struct_size;         /**< sizeof(cairn_localize_query) */
  const cairn_image* image;   /**< of the size of the camera */
  const cairn_camera* camera; /**< of that image */
  int64_t time_ns;            /**< when it was taken, on the caller's clock; may be 0 */
  const cairn_prior* prior;   /**< NULL: none */
} cairn_localize_query;

/** A part of the map with a frame of its own. */
typedef struct cairn_component {
  size_t struct_size;              /**< sizeof(cairn_component) */
  uint32_t id;                     /**< in the map; never used twice */
  int32_t aligned;                 /**< 1: its place in the world is known */
  int64_t keyframes;               /**< in it */
  cairn_pose world_from_component; /**< with the scale: point_world = scale * rotation * point + translation */
  double scale;                    /**< metres per unit of the map */
} cairn_component;

/** The stages of finding a single image, in order; a miss names the one that failed (cairn/answers.h). */
enum cairn_localize_stage {
  CAIRN_STAGE_FEATURES = 0,   /**< too few features */
  CAIRN_STAGE_CANDIDATES = 1, /**< nothing looks like it */
  CAIRN_STAGE_MATCHES = 2,    /**< too few features match */
  CAIRN_STAGE_PNP = 3,        /**< they agree on no pose */
  CAIRN_STAGE_REFINEMENT = 4, /**< the rest does not confirm it */
  CAIRN_STAGE_RIVALS = 5,     /**< several places fit about as well */
  CAIRN_STAGE_DONE = 6        /**< found */
};

/** Whether the lens that the map has found for its camera was applied. */
enum cairn_lens_use {
  CAIRN_LENS_NONE = 0,             /**< the map corrects no lens */
  CAIRN_LENS_CORRECTED = 1,        /**< the image's camera is one that it corrects */
  CAIRN_LENS_OTHER_CALIBRATION = 2 /**< it corrects a lens, but of no camera with this calibration */
};

/** One of several places that an image fits. It has no struct_size and stays as it is. */
typedef struct cairn_rival {
  cairn_pose map_from_camera;   /**< in the frame of the component, in its units */
  cairn_pose world_from_camera; /**< the same while the component is not aligned */
  double position_sigma;        /**< of the camera's place, in units of the map */
  double rotation_sigma_rad;    /**< of its orientation */
  uint32_t component;           /**< that it is in */
  uint32_t reference_keyframe;  /**< the one that shares most points */
  int32_t inliers;              /**< points of the map that are seen where the pose puts them */
  int32_t world_is_metric;      /**< 1: the component has been aligned */
} cairn_rival;

enum { CAIRN_MAX_RIVALS = 4 /**< as many as an answer has room for */ };

/** Where a single image was taken, or why that is not known. */
typedef struct cairn_localize_answer {
  size_t struct_size;                   /**< sizeof(cairn_localize_answer) */
  int32_t localized;                    /**< 1: the pose is valid */
  int32_t stage;                        /**< cairn_localize_stage reached */
  cairn_pose map_from_camera;           /**< in the frame of the component, in its units */
  cairn_pose world_from_camera;         /**< the same while the component is not aligned */
  double world_per_map;                 /**< metres per unit of the map, once aligned */
  double covariance[36];                /**< of map_from_camera, row by row, as PoseCovariance in cairn/pose.h */
  double position_sigma;                /**< of the camera's place, in units of the map */
  double rotation_sigma_rad;            /**< of its orientation */
  int32_t world_is_metric;              /**< 1: the component has been aligned */
  int32_t components;                   /**< that the map has */
  uint32_t component;                   /**< 0: none */
  uint32_t reference_keyframe;          /**< 0: none */
  uint64_t revision;                    /**< of the map that was asked */
  double extract_ms;                    /**< time for the features of the image */
  double locate_ms;                     /**< and for the rest */
  int32_t features;                     /**< in the image */
  int32_t candidates;                   /**< keyframes that share enough words with it */
  int32_t word_matches;                 /**< features that match one of these */
  int32_t pnp_inliers;                  /**< that agree on a pose */
  int32_t guided_matches;               /**< points of the map found where that pose puts them */
  int32_t inliers;                      /**< of these, after refinement */
  int32_t lens;                         /**< cairn_lens_use */
  char map_id[40];                      /**< 32 hex digits */
  char reason[260];                     /**< of a miss, for people */
  double focal_factor;                  /**< what the camera's focal length should be multiplied by; 1: it fits */
  int32_t num_rivals;                   /**< of CAIRN_STAGE_RIVALS, the first CAIRN_MAX_RIVALS of which are below */
  int32_t reserved;                     /**< 0 */
  cairn_rival rivals[CAIRN_MAX_RIVALS]; /**< most inliers first */
} cairn_localize_answer;

/** How the images of a stream are followed (cairn/tracker.h). */
enum cairn_track_mode {
  CAIRN_TRACK_SEMI_DIRECT = 0, /**< by their brightness, anchored in the map */
  CAIRN_TRACK_FEATURES = 1     /**< by features */
};

/** How a tracker works; NULL instead of one: as usual. */
typedef struct cairn_tracker_options {
  size_t struct_size;             /**< sizeof(cairn_tracker_options) */
  int32_t mode;                   /**< cairn_track_mode */
  int32_t deterministic;          /**< 1: everything in the thread that calls */
  int32_t relocalize_beside_call; /**< 1: an image without a pose is looked for beside the calls, not within */
  int32_t wait_for_matches;       /**< 1: for recordings that are read faster than they were made */
} cairn_tracker_options;

/** How a tracker knows where it is. */
enum cairn_track_state {
  CAIRN_LOCATED = 0, /**< found in the map, not by following the image before */
  CAIRN_TRACKED = 1, /**< followed, and matched against the map */
  CAIRN_CARRIED = 2, /**< followed from where the map was last matched */
  CAIRN_LOST = 3     /**< there is no pose */
};

/** Where one image of a stream was taken. */
typedef struct cairn_track_answer {
  size_t struct_size;           /**< sizeof(cairn_track_answer) */
  int64_t time_ns;              /**< of the image */
  int32_t state;                /**< cairn_track_state */
  uint32_t component;           /**< 0: none */
  cairn_pose map_from_camera;   /**< in the frame of the component, in its units */
  cairn_pose world_from_camera; /**< the same while the component is not aligned */
  double world_per_map;         /**< metres per unit of the map, once aligned */
  double covariance[36];        /**< of map_from_camera, row by row */
  double position_sigma;        /**< of the camera's place, in units of the map */
  double rotation_sigma_rad;    /**< of its orientation */
  int32_t world_is_metric;      /**< 1: the component has been aligned */
  int32_t inliers;              /**< points of the map that were matched last */
  int64_t matched_ns;           /**< time of the image that was matched last; 0: none yet */
  uint64_t revision;            /**< of the map that the pose is from */
  double track_ms;              /**< time that the call took */
  char map_id[40];              /**< 32 hex digits */
  char reason[256];             /**< of CAIRN_CARRIED and CAIRN_LOST, for people */
  char note[256];               /**< what keeps the tracker from following the map; it goes on without */
  int32_t connected;            /**< 1: to the server of the map; always for a file */
  int32_t reserved;             /**< 0 */
  double map_age_s;             /**< since what is known of the map was the newest for certain; 0 for a file */
  double focal_factor;          /**< what the camera's focal length should be multiplied by; 1: it fits */
} cairn_track_answer;

/** The version of the library that is loaded: "0.1.0". */
CAIRN_C_API const char* cairn_version(void);
/** "NOT_FOUND" of CAIRN_NOT_FOUND. */
CAIRN_C_API const char* cairn_code_name(cairn_code code);
/** "place candidates" of CAIRN_STAGE_CANDIDATES. */
CAIRN_C_API const char* cairn_localize_stage_name(int32_t stage);
/** "tracked" of CAIRN_TRACKED. */
CAIRN_C_API const char* cairn_track_state_name(int32_t state);

/** NULL if there is no memory. */
CAIRN_C_API cairn_cancellation* cairn_cancellation_new(void);
/** Calls that were given it end with CAIRN_CANCELLED, those that come later, too. From any thread; NULL does nothing.
 */
CAIRN_C_API void cairn_cancellation_cancel(cairn_cancellation* cancellation);
/** When no call uses it any more; NULL does nothing. */
CAIRN_C_API void cairn_cancellation_free(cairn_cancellation* cancellation);

/** Loads the newest revision of the map file at `path`, or of a map "cairn://HOST:PORT/NAME" of a server, as
 * cairn::Map::Open(). */
CAIRN_C_API cairn_code cairn_map_open(const char* path, const cairn_map_options* options,
                                      const cairn_call_options* call, cairn_map** map, cairn_error* error);
/** NULL does nothing. */
CAIRN_C_API void cairn_map_close(cairn_map* map);
/** Of the revision that the map is at. */
CAIRN_C_API cairn_code cairn_map_get_info(const cairn_map* map, cairn_map_info* info, cairn_error* error);
/** A camera that made part of the map, `index` from 0. CAIRN_OUT_OF_RANGE beyond the last one. */
CAIRN_C_API cairn_code cairn_map_get_camera(const cairn_map* map, int32_t index, cairn_camera* camera,
                                            cairn_error* error);
/** A part of the map, `index` from 0. CAIRN_OUT_OF_RANGE beyond the last one. */
CAIRN_C_API cairn_code cairn_map_get_component(const cairn_map* map, int32_t index, cairn_component* component,
                                               cairn_error* error);
/** Goes on to the newest revision; `changed`, which may be NULL, becomes 1 if there was one, else 0. */
CAIRN_C_API cairn_code cairn_map_refresh(const cairn_map* map, const cairn_call_options* call, int32_t* changed,
                                         cairn_error* error);

/** Finds single images in a map. */
CAIRN_C_API cairn_code cairn_localizer_new(const cairn_map* map, cairn_localizer** localizer, cairn_error* error);
/** NULL does nothing. */
CAIRN_C_API void cairn_localizer_free(cairn_localizer* localizer);
/** A miss is CAIRN_OK, with `localized` 0. */
CAIRN_C_API cairn_code cairn_localizer_localize(const cairn_localizer* localizer, const cairn_localize_query* query,
                                                const cairn_call_options* call, cairn_localize_answer* answer,
                                                cairn_error* error);

/** Follows a stream of images of `camera`. */
CAIRN_C_API cairn_code cairn_tracker_new(const cairn_map* map, const cairn_camera* camera,
                                         const cairn_tracker_options* options, const cairn_call_options* call,
                                         cairn_tracker** tracker, cairn_error* error);
/** Ends its threads; NULL does nothing. */
CAIRN_C_API void cairn_tracker_free(cairn_tracker* tracker);
/** `time_ns` is later than that of the image before. A loss is CAIRN_OK, with the state CAIRN_LOST. */
CAIRN_C_API cairn_code cairn_tracker_track(cairn_tracker* tracker, const cairn_image* image, int64_t time_ns,
                                           const cairn_call_options* call, cairn_track_answer* answer,
                                           cairn_error* error);

#ifdef __cplusplus
}
#endif

#endif
