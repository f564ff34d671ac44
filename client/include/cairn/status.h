/// \file
/// Errors are values: absl::Status, and absl::StatusOr for what may be missing because of one. The message says what
/// was wrong, where, and what to do; the code says what a program can do about it:
///
/// | code | of |
/// |---|---|
/// | kInvalidArgument | an image, camera, time or option that makes no sense; a file that is no map |
/// | kNotFound | there is no such map |
/// | kDataLoss | the map is damaged |
/// | kUnimplemented | the map is of a newer version; or this version of the library cannot do that yet |
/// | kFailedPrecondition | the map cannot be used so (no vocabulary, a foreign log beside it); a moved-from object |
/// | kAborted | the map was removed, moved or replaced while it was open: open it again |
/// | kPermissionDenied | the file cannot be read |
/// | kResourceExhausted | memory, threads or room on the disk ran out |
/// | kUnavailable | not now: try again |
/// | kDeadlineExceeded, kCancelled | as the caller wanted it (call_options.h) |
/// | kInternal | the operating system or a library failed; the message has what it said |
///
/// No function of the library throws, or ends the process. (absl::StatusOr itself does when asked for the value of an
/// error: ask ok() first.) That an image shows nothing of the map is an answer, not an error.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>
