#include "server/http/json_body.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/util/json_util.h>

#include <nlohmann/json.hpp>
#include <optional>
#include <vector>

#include "absl/strings/str_join.h"
#include "base/shown.h"

namespace cairn::server {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::FieldDescriptor;
using nlohmann::json;

absl::Status BadMessage(absl::string_view what) { return absl::InvalidArgumentError(absl::StrCat("request: ", what)); }

// Why a text is no JSON.
std::string WhyNoJson(const std::string& text) {
  try {
    const json ignored = json::parse(text);
  } catch (const json::parse_error& error) {
    return absl::StrCat("the body is no JSON, from byte ", error.byte, " on");
  } catch (const json::exception&) {  // out_of_range: what the parser says of 1e999
    return "a number in the body is too large";
  }
  return "the body is no JSON";
}

const FieldDescriptor* FieldOf(const Descriptor& type, const std::string& name) {
  const FieldDescriptor* field = type.FindFieldByName(name);
  for (int i = 0; field == nullptr && i < type.field_count(); ++i) {
    if (type.field(i)->json_name() == name) field = type.field(i);
  }
  return field;
}

std::string FieldsOf(const Descriptor& type) {
  std::vector<std::string> names;
  for (int i = 0; i < type.field_count(); ++i) names.push_back(type.field(i)->name());
  return names.empty() ? "nothing is taken" : absl::StrCat("there are ", absl::StrJoin(names, ", "));
}

// The first field that its message does not have, with those that it has; as deep as the messages are.
std::optional<std::string> UnknownField(const json& value, const Descriptor& type, const std::string& path) {
  if (!value.is_object()) return std::nullopt;
  for (const auto& [name, member] : value.items()) {
    const std::string inner = absl::StrCat(path, path.empty() ? "" : ".", name);
    const FieldDescriptor* field = FieldOf(type, name);
    if (field == nullptr) return absl::StrCat("there is no field `", Shown(inner, 100), "`; ", FieldsOf(type));
    if (field->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE || field->is_map()) continue;
    const Descriptor& of_field = *field->message_type();
    if (!member.is_array()) {
      if (auto unknown = UnknownField(member, of_field, inner)) return unknown;
      continue;
    }
    for (std::size_t i = 0; i < member.size(); ++i) {
      if (auto unknown = UnknownField(member[i], of_field, absl::StrCat(inner, "[", i, "]"))) return unknown;
    }
  }
  return std::nullopt;
}

}  // namespace

absl::Status ReadJsonMessage(const std::string& body, google::protobuf::Message* message) {
  const auto read = google::protobuf::util::JsonStringToMessage(body, message);
  if (read.ok()) return absl::OkStatus();
  const json parsed = json::parse(body, nullptr, /*allow_exceptions=*/false);
  if (parsed.is_discarded()) return BadMessage(WhyNoJson(body));
  if (!parsed.is_object()) return BadMessage("the body must be an object of JSON: {...}");
  if (const auto unknown = UnknownField(parsed, *message->GetDescriptor(), "")) return BadMessage(*unknown);
  return BadMessage(Shown(absl::string_view(read.message().data(), read.message().size()), 300));
}

}  // namespace cairn::server
