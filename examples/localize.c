/* Where a photo (grey PGM) was taken, in C, by the camera that the map was made with: localize office.cairn photo.pgm
 * Exit codes: 0 located, 4 not located, 1 failure, 2 usage. */
#include <cairn.h>
#include <stdio.h>
#include <stdlib.h>

/* The pixels, which the caller frees; NULL if there are none. */
static uint8_t* ReadPgm(const char* path, cairn_image* image) {
  uint8_t* pixels = NULL;
  int width = 0, height = 0, brightest = 0;
  FILE* file = fopen(path, "rb");
  if (file == NULL) return NULL;
  if (fscanf(file, "P5 %d %d %d", &width, &height, &brightest) == 3 && brightest == 255 && fgetc(file) != EOF &&
      width > 0 && height > 0 && width <= 16384 && height <= 16384) {
    const size_t size = (size_t)width * (size_t)height;
    pixels = malloc(size);
    if (pixels != NULL && fread(pixels, 1, size, file) != size) {
      free(pixels);
      pixels = NULL;
    }
  }
  fclose(file);
  image->data = pixels;
  image->width_px = width;
  image->height_px = height;
  return pixels;
}

int main(int argc, char** argv) {
  cairn_error error = {sizeof error};
  cairn_camera camera = {sizeof camera};
  cairn_image image = {sizeof image};
  cairn_localize_query query = {sizeof query};
  cairn_localize_answer answer = {sizeof answer};
  cairn_call_options call = {sizeof call};
  cairn_map* map = NULL;
  cairn_localizer* localizer = NULL;
  uint8_t* pixels = NULL;
  int code = 1;
  if (argc != 3) {
    fprintf(stderr, "usage: localize MAP PHOTO.pgm\n");
    return 2;
  }
  pixels = ReadPgm(argv[2], &image);
  query.image = &image;
  query.camera = &camera;
  call.timeout_ns = 10000000000; /* 10 s */
  if (pixels == NULL) {
    fprintf(stderr, "localize: %s: no 8-bit PGM image can be read from it\n", argv[2]);
  } else if (cairn_map_open(argv[1], NULL, NULL, &map, &error) != CAIRN_OK ||
             cairn_map_get_camera(map, 0, &camera, &error) != CAIRN_OK ||
             cairn_localizer_new(map, &localizer, &error) != CAIRN_OK ||
             cairn_localizer_localize(localizer, &query, &call, &answer, &error) != CAIRN_OK) {
    fprintf(stderr, "localize: %s: %s\n", cairn_code_name(error.code), error.message);
  } else if (answer.localized) {
    const double* at = answer.world_from_camera.translation;
    printf("%.4f %.4f %.4f %s, +- %.4f\n", at[0], at[1], at[2], answer.world_is_metric ? "m" : "map units",
           answer.world_per_map * answer.position_sigma);
    code = 0;
  } else {
    printf("not located at stage \"%s\": %s\n", cairn_localize_stage_name(answer.stage), answer.reason);
    code = 4;
  }
  cairn_localizer_free(localizer);
  cairn_map_close(map);
  free(pixels);
  return code;
}
