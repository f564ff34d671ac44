/* A C program against the installed header and library. usage: robot_c MAP */
#include <cairn.h>
#include <stdio.h>
#include <string.h>

#define CHECK(condition)                                                                      \
  if (!(condition)) {                                                                         \
    fprintf(stderr, "robot_c: line %d: %s fails: %s\n", __LINE__, #condition, error.message); \
    return 1;                                                                                 \
  }

int main(int argc, char** argv) {
  static uint8_t pixels[480 * 360]; /* black: a miss */
  cairn_error error = {sizeof error};
  cairn_map_info info = {sizeof info};
  cairn_camera camera = {sizeof camera};
  cairn_image image = {sizeof image};
  cairn_localize_query query = {sizeof query};
  cairn_localize_answer answer = {sizeof answer};
  cairn_track_answer tracked = {sizeof tracked};
  cairn_map* map = NULL;
  cairn_localizer* localizer = NULL;
  cairn_tracker* tracker = NULL;
  if (argc != 2) return 2;
  CHECK(strcmp(cairn_version(), CAIRN_VERSION) == 0);
  CHECK(cairn_map_open("/no/such/map.cairn", NULL, NULL, &map, &error) == CAIRN_NOT_FOUND);
  CHECK(strstr(error.message, "/no/such/map.cairn") != NULL);
  CHECK(cairn_map_open(argv[1], NULL, NULL, &map, &error) == CAIRN_OK);
  CHECK(cairn_map_get_info(map, &info, &error) == CAIRN_OK);
  CHECK(info.keyframes == 10 && info.cameras == 1 && strlen(info.id) == 32);
  CHECK(cairn_map_get_camera(map, 0, &camera, &error) == CAIRN_OK);
  CHECK(camera.width_px == 480 && camera.height_px == 360);
  CHECK(cairn_localizer_new(map, &localizer, &error) == CAIRN_OK);
  image.data = pixels;
  image.width_px = 480;
  image.height_px = 360;
  query.image = &image;
  query.camera = &camera;
  CHECK(cairn_localizer_localize(localizer, &query, NULL, &answer, &error) == CAIRN_OK);
  CHECK(!answer.localized && answer.stage == CAIRN_STAGE_FEATURES && answer.reason[0] != 0);
  CHECK(cairn_tracker_new(map, &camera, NULL, NULL, &tracker, &error) == CAIRN_OK);
  CHECK(cairn_tracker_track(tracker, &image, 1, NULL, &tracked, &error) == CAIRN_OK);
  CHECK(tracked.state == CAIRN_LOST && tracked.reason[0] != 0);
  cairn_tracker_free(tracker);
  cairn_map_close(map);
  cairn_localizer_free(localizer);
  printf("robot_c: all is well with cairn %s\n", cairn_version());
  return 0;
}
