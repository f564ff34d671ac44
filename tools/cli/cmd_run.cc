// cairn run: maps a sequence into a map file, or only tracks it.
#include <array>

#include "cli/cli.h"
#include "cli/run_options.h"
#include "cli/server_option.h"

namespace cairn::cli {
namespace {

// What only the one who holds the map file can do, or decides for all of its clients: not with --server.
constexpr std::array<const char*, 12> kLocalOptions = {
    "--odometry-only", "--poses",   "--vocabulary", "--picture",    "--quality", "--keyframes",
    "--deterministic", "--threads", "--vo",         "--fixed-lens", "--preset",  "--full-resolution"};

int Run(const RunOptions& options) {
  InterruptWatch interrupt;
  const absl::Status status = !options.server.empty()  ? MapServed(options, &interrupt)
                              : options.odometry_only  ? TrackSequence(options, &interrupt)
                              : !options.poses.empty() ? MapStills(options, &interrupt)
                                                       : MapSequence(options, &interrupt);
  const int code = status.ok() ? kOk : Fail("run", status, options.json);
  return interrupt.exit_code() != 0 ? interrupt.exit_code() : code;
}

}  // namespace

FeedSettings ToFeedSettings(const RunOptions& options, std::string progress) {
  FeedSettings settings;
  settings.verb = "run";
  settings.progress = std::move(progress);
  settings.quiet = options.json;
  settings.feed.in_background = !options.session.deterministic && options.threads != 1;
  settings.feed.realtime_speed = options.realtime_speed;
  return settings;
}

// Offline the feed reads ahead in its own thread; a second one would only make it wait. A live camera's images are
// there when they are due.
absl::StatusOr<std::unique_ptr<io::FrameSource>> OpenRunInput(const RunOptions& options) {
  InputOptions input = options.input;
  const bool feed_reads = !options.session.deterministic && options.realtime_speed == 0.0 && options.poses.empty();
  if (feed_reads) input.open.prefetch = 0;
  return OpenInput(input, "run");
}

void AddRunCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("run", "Map a sequence into a map file, or only track it");
  auto options = std::make_shared<RunOptions>();
  AddInputOptions(verb, &options->input);
  CLI::Option* map =
      verb->add_option("--map", options->map, "The map file to write (.cairn), with --server the name of a map there");
  CLI::Option* odometry_only = verb->add_flag("--odometry-only", options->odometry_only,
                                              "No map: the direct odometry alone, for its poses or its speed");
  CLI::Option* extend = verb->add_flag(
      "--extend", options->extend,
      "Add this session to a map that exists: it maps into a component of its own until it is found, beyond doubt, in "
      "what the map has");
  CLI::Option* name = verb->add_option("--name", options->name, "Name of the map; the sequence's if not given");
  CLI::Option* camera_name = verb->add_option(
      "--camera-name", options->camera_name,
      "Name of the camera in the map; after its calibration if not given. A camera that the map knows is recognized by "
      "its calibration");
  extend->excludes(name);
  verb->add_option("--trajectory", options->trajectory,
                   "Write the final pose of every frame to this file (TUM format)");
  CLI::Option* quality = verb->add_option("--quality", options->quality,
                                          "Write how sure each pose of the trajectory is to this file (CSV: t, "
                                          "quality, sigma_position, sigma_rotation_deg). "
                                          "Poses of a quality below 0.5 are not to be relied on");
  CLI::Option* live_poses = verb->add_option(
      "--live-poses", options->live_poses,
      "Write the pose of each frame in the map to this file as soon as it is tracked (TUM format, a "
      "line each): what was known then, without what loops and adjustments improved since. There is none before "
      "the first keyframes are in the map, which comes after they have left the odometry's window. A comment line says "
      "whose frame follows: another one once a session is joined to what was there; the world where that is aligned");
  verb->add_option("--keyframes", options->keyframes,
                   "Write the poses of the map's keyframes to this file (TUM format)");
  CLI::Option* poses =
      verb->add_option("--poses", options->poses, "Known camera poses of still images: maps them without odometry");
  CLI::Option* vocabulary = verb->add_option("--vocabulary", options->vocabulary,
                                             "Vocabulary file; the one that comes with Cairn if not given");
  CLI::Option* picture =
      verb->add_option("--picture", options->picture, "Draw the map from above to this .png or .svg file");
  CLI::Option* deterministic = verb->add_flag("--deterministic", options->session.deterministic,
                                              "One thread, fixed order: two runs give identical output");
  verb->add_option("--threads", options->threads,
                   "1: everything in one, in the order of --deterministic; 2: the feature module in one of its own; "
                   "3: mapping of the odometry too (default). Reading images ahead takes a further one, except with 1")
      ->check(CLI::Range(1, 64))
      ->excludes(deterministic);
  verb->add_option("--realtime", options->realtime_speed,
                   "Play the sequence like a live camera, at SPEED times its own pace (1 if not given): frames that "
                   "come while tracking is busy are dropped, and counted")
      ->type_name("[SPEED]")
      ->check(CLI::Range(0.001, 1000.0))
      ->excludes(deterministic)
      ->excludes(poses);
  CLI::Option* vo = verb->add_flag_callback(
      "--vo", [options] { options->session.close_loops = false; },
      "Visual odometry: close no loops; parts of the map that are far apart along the path stay apart");
  CLI::Option* fixed_lens = verb->add_flag_callback(
      "--fixed-lens", [options] { options->session.mapping.lens.enabled = false; },
      "Keep to the calibration: do not correct focal length and radial distortion by what the map says of them");
  verb->add_option(
          "--preset", options->preset,
          "What the odometry may spend. fast: fewer points and keyframes, four fifths of the time, three times the "
          "error on handheld indoor recordings; accurate: more points and iterations, half as much time again, "
          "slightly better on average (docs/benchmarks.md)")
      ->check(CLI::IsMember({"fast", "default", "accurate"}))
      ->capture_default_str();
  verb->add_flag("--full-resolution", options->full_resolution, "Track on full instead of half resolution: slower");
  verb->add_flag("--overwrite", options->overwrite, "Replace files that exist");
  verb->add_flag("--json", options->json, "Answer in JSON");
  poses->excludes(live_poses);
  poses->excludes(quality);
  extend->excludes(vocabulary);
  for (CLI::Option* of_maps :
       {map, extend, name, camera_name, poses, vocabulary, picture, vo, fixed_lens, live_poses, quality}) {
    odometry_only->excludes(of_maps);
  }
  for (const char* local : kLocalOptions) {
    CLI::Option* option = verb->get_option(local);
    option->description(option->get_description() + ". Not with --server");
  }
  verb->footer(
      "Examples:\n"
      "  cairn run rgbd_dataset --camera camera.yaml --map office.cairn\n"
      "  cairn run MH_01_easy --map hall.cairn --until 60 --trajectory frames.txt\n"
      "  cairn run MH_02_easy --map hall.cairn --extend --trajectory frames_2.txt\n"
      "  cairn run stills --poses poses.txt --map stills.cairn\n"
      "  cairn run rgbd_dataset --camera camera.yaml --odometry-only --trajectory frames.txt\n"
      "  cairn --server localhost:7878 run visit --map office --extend");
  verb->callback([=, &app] {
    options->server = ServerOf(app);
    for (const char* local : kLocalOptions) {
      if (!options->server.empty() && verb->get_option(local)->count() > 0) throw CLI::ExcludesError(local, "--server");
    }
    if (!options->odometry_only && options->map.empty()) {
      throw CLI::RequiredError("--map (or --odometry-only, which makes none)");
    }
    const absl::StatusOr<direct::Preset> preset = direct::PresetFromName(options->preset);
    if (preset.ok()) options->session.odometry = direct::PresetOptions(*preset);
    options->session.odometry.full_resolution |= options->full_resolution;
    *action = [=] { return Run(*options); };
  });
}

}  // namespace cairn::cli
