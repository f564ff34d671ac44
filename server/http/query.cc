#include "server/http/query.h"

#include <google/protobuf/descriptor.h>

#include <set>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"

namespace cairn::server {
namespace {

using google::protobuf::FieldDescriptor;

int HexDigit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  const char lower = absl::ascii_tolower(static_cast<unsigned char>(c));
  return lower >= 'a' && lower <= 'f' ? lower - 'a' + 10 : -1;
}

// In queries, but not in paths, a plus stands for a space.
absl::StatusOr<std::string> Decoded(absl::string_view text, bool in_query) {
  std::string decoded;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '%') {
      decoded.push_back(in_query && text[i] == '+' ? ' ' : text[i]);
      continue;
    }
    const int high = i + 2 < text.size() ? HexDigit(text[i + 1]) : -1;
    const int low = high >= 0 ? HexDigit(text[i + 2]) : -1;
    if (low < 0) return absl::InvalidArgumentError("a % must be followed by two hexadecimal digits");
    decoded.push_back(static_cast<char>(16 * high + low));
    i += 2;
  }
  return decoded;
}

bool CanBeSet(const FieldDescriptor& field) {
  return !field.is_repeated() && field.cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE;
}

// False if the text is no such value.
bool Set(const FieldDescriptor* field, const std::string& text, google::protobuf::Message* message) {
  const google::protobuf::Reflection& fields = *message->GetReflection();
  const auto number = [&](auto value, auto set) {
    if (!absl::SimpleAtoi(text, &value)) return false;
    (fields.*set)(message, field, value);
    return true;
  };
  using Fields = google::protobuf::Reflection;
  switch (field->cpp_type()) {
    case FieldDescriptor::CPPTYPE_INT32:
      return number(std::int32_t{0}, &Fields::SetInt32);
    case FieldDescriptor::CPPTYPE_INT64:
      return number(std::int64_t{0}, &Fields::SetInt64);
    case FieldDescriptor::CPPTYPE_UINT32:
      return number(std::uint32_t{0}, &Fields::SetUInt32);
    case FieldDescriptor::CPPTYPE_UINT64:
      return number(std::uint64_t{0}, &Fields::SetUInt64);
    case FieldDescriptor::CPPTYPE_BOOL: {
      bool value = false;
      if (!absl::SimpleAtob(text, &value)) return false;
      fields.SetBool(message, field, value);
      return true;
    }
    case FieldDescriptor::CPPTYPE_ENUM: {
      const auto* value = field->enum_type()->FindValueByName(text);
      if (value == nullptr) return false;
      fields.SetEnum(message, field, value);
      return true;
    }
    case FieldDescriptor::CPPTYPE_STRING:
      fields.SetString(message, field, text);
      return true;
    default:
      return false;
  }
}

}  // namespace

absl::StatusOr<QueryParameters> ParseQuery(absl::string_view query) {
  QueryParameters parameters;
  for (const absl::string_view part : absl::StrSplit(query, '&', absl::SkipEmpty())) {
    const std::pair<absl::string_view, absl::string_view> split = absl::StrSplit(part, absl::MaxSplits('=', 1));
    const absl::StatusOr<std::string> name = Decoded(split.first, true), value = Decoded(split.second, true);
    for (const auto* decoded : {&name, &value}) CAIRN_RETURN_IF_ERROR(Annotate(decoded->status(), "query"));
    parameters.emplace_back(*name, *value);
  }
  return parameters;
}

absl::StatusOr<std::string> DecodedPath(absl::string_view part) { return Decoded(part, /*in_query=*/false); }

absl::Status SetFields(const QueryParameters& parameters, absl::string_view taken, google::protobuf::Message* message) {
  const google::protobuf::Descriptor& type = *message->GetDescriptor();
  std::vector<std::string> names;
  for (int i = 0; i < type.field_count(); ++i) {
    const FieldDescriptor& field = *type.field(i);
    if (CanBeSet(field) && field.name() != taken) names.push_back(field.name());
  }
  std::set<std::string> seen;
  for (const auto& [name, value] : parameters) {
    const FieldDescriptor* field = type.FindFieldByName(name);
    if (field == nullptr || !CanBeSet(*field) || name == taken) {
      return absl::InvalidArgumentError(
          absl::StrCat("query: there is no `", name, "` here; ",
                       names.empty() ? "nothing is taken" : absl::StrCat("there are ", absl::StrJoin(names, ", "))));
    }
    if (!seen.insert(name).second) return absl::InvalidArgumentError(absl::StrCat("query: `", name, "` is repeated"));
    // Whoever says both cannot mean both.
    if (message->GetReflection()->HasField(*message, field)) {
      return absl::InvalidArgumentError(absl::StrCat("query: `", name, "` is in the body, too"));
    }
    if (!Set(field, value, message)) {
      return absl::InvalidArgumentError(absl::StrCat("query: `", name, "` cannot be \"", value, "\""));
    }
  }
  return absl::OkStatus();
}

}  // namespace cairn::server
