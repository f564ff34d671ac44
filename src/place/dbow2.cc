#include "place/dbow2.h"

#include <charconv>
#include <cstdint>
#include <sstream>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "base/files.h"

namespace cairn::place {
namespace {

// Reads numbers separated by blanks from one line.
class LineReader {
 public:
  explicit LineReader(std::string_view line) : rest_(line) {}

  template <class T>
  bool Next(T* value) {
    SkipBlanks();
    const auto [end, error] = std::from_chars(rest_.data(), rest_.data() + rest_.size(), *value);
    if (error != std::errc()) return false;
    rest_.remove_prefix(static_cast<std::size_t>(end - rest_.data()));
    return rest_.empty() || IsBlank(rest_.front());
  }
  bool AtEnd() {
    SkipBlanks();
    return rest_.empty();
  }

 private:
  static bool IsBlank(char c) { return c == ' ' || c == '\t' || c == '\r'; }
  void SkipBlanks() {
    while (!rest_.empty() && IsBlank(rest_.front())) rest_.remove_prefix(1);
  }
  std::string_view rest_;
};

struct ParsedNode {
  Vocabulary::Node node;
  bool is_leaf = false;
};

// An error text, or empty.
std::string ParseNode(std::string_view line, std::size_t number_of_nodes, ParsedNode* out) {
  LineReader reader(line);
  int is_leaf = 0;
  if (!reader.Next(&out->node.parent)) return "expected the parent's number";
  if (out->node.parent >= number_of_nodes) {
    return absl::StrCat("the parent ", out->node.parent, " is not an earlier node (there are ", number_of_nodes, ")");
  }
  if (!reader.Next(&is_leaf) || is_leaf < 0 || is_leaf > 1) return "expected 0 or 1 (is it a leaf) after the parent";
  out->is_leaf = is_leaf == 1;
  for (std::size_t i = 0; i < 32; ++i) {
    unsigned byte = 0;
    if (!reader.Next(&byte) || byte > 255) {
      return absl::StrCat("expected 32 descriptor bytes (0 to 255); number ", i + 1, " is missing or wrong");
    }
    out->node.descriptor[i / 8] |= static_cast<std::uint64_t>(byte) << (8 * (i % 8));
  }
  if (!reader.Next(&out->node.weight)) return "expected the weight after the descriptor";
  if (!(out->node.weight >= 0.0f && out->node.weight < 1e30f)) return "the weight must be finite and not negative";
  if (!reader.AtEnd()) return "there is more on the line than parent, leaf flag, 32 bytes and weight";
  return "";
}

}  // namespace

absl::StatusOr<Vocabulary> ImportDbow2Text(std::istream& in, const std::string& name) {
  std::size_t line_number = 1;
  const auto fail = [&](std::size_t at_line, absl::string_view what) {
    return absl::InvalidArgumentError(absl::StrCat(name, ":", at_line, ": ", what, " (DBoW2 text vocabulary)"));
  };
  std::string line;
  if (!std::getline(in, line)) return fail(1, "the file is empty; expected 'k L scoring weighting'");
  LineReader header(line);
  int branching = 0, depth = 0, scoring = 0, weighting = 0;
  if (!header.Next(&branching) || !header.Next(&depth) || !header.Next(&scoring) || !header.Next(&weighting) ||
      !header.AtEnd()) {
    return fail(1, "expected four whole numbers 'k L scoring weighting'");
  }
  if (branching < 2 || branching > Vocabulary::kMaxBranching || depth < 1 || depth > Vocabulary::kMaxDepth) {
    return fail(1, absl::StrCat("k must be between 2 and ", Vocabulary::kMaxBranching, " and L between 1 and ",
                                Vocabulary::kMaxDepth, ", not ", branching, " and ", depth));
  }
  if (scoring != 0 || weighting != 0) {
    return fail(1, absl::StrCat("scoring ", scoring, " and weighting ", weighting,
                                " are not supported; only 0 0 (L1 norm, tf-idf) is"));
  }

  std::vector<Vocabulary::Node> nodes(1);
  struct Info {
    std::size_t line = 1;
    int level = 0;
    int children = 0;
    bool is_leaf = false;
  };
  std::vector<Info> info(1);
  while (std::getline(in, line)) {
    ++line_number;
    if (LineReader(line).AtEnd()) continue;
    ParsedNode parsed;
    if (const std::string error = ParseNode(line, nodes.size(), &parsed); !error.empty()) {
      return fail(line_number, error);
    }
    Info& parent = info[parsed.node.parent];
    if (parent.is_leaf) {
      return fail(line_number, absl::StrCat("the parent ", parsed.node.parent, " is a leaf (line ", parent.line, ")"));
    }
    if (++parent.children > branching) {
      return fail(line_number,
                  absl::StrCat("node ", parsed.node.parent, " has more than k = ", branching, " children"));
    }
    const int level = parent.level + 1;
    if (level > depth) return fail(line_number, absl::StrCat("the node is deeper than L = ", depth));
    if (nodes.size() >= Vocabulary::kMaxNodes) return fail(line_number, "too many nodes");
    info.push_back({line_number, level, 0, parsed.is_leaf});
    nodes.push_back(parsed.node);
  }
  if (in.bad()) return absl::UnavailableError(absl::StrCat(name, ": reading failed after line ", line_number));
  if (nodes.size() < 2) return fail(line_number, "there are no nodes after the first line; the file is truncated");
  for (const Info& node : info) {
    if (!node.is_leaf && node.children == 0) {
      return fail(node.line, "the node is not a leaf but has no children; the file is truncated or damaged");
    }
  }
  absl::StatusOr<Vocabulary> vocabulary = Vocabulary::FromNodes(nodes, branching, depth);
  if (!vocabulary.ok()) return Annotate(vocabulary.status(), name);
  return vocabulary;
}

absl::StatusOr<Vocabulary> ImportDbow2TextFile(const std::string& path) {
  CAIRN_ASSIGN_OR_RETURN(std::string text, ReadWholeFile(path));
  std::istringstream in(std::move(text));
  return ImportDbow2Text(in, path);
}

}  // namespace cairn::place
