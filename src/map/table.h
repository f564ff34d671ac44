// A persistent table from dense ids to immutable values. Copying a table is O(1) and the copy never changes; a change
// costs O(log32 n) whatever the size. This is what makes a map::Snapshot cheap to publish and safe to read without
// locks.
//
// A radix tree with 32 children per node, in the manner of Bagwell, "Ideal hash trees" (2001), without hashing as ids
// are dense. Below it there may be a source of values that are not in memory: then the tree holds, by whole leaves,
// what is not as it is there.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>

#include "map/entity_source.h"

namespace cairn::map {

// Names one batch of changes. A node made in the batch may be changed in place by it; every other node is copied first.
class TableEdit {
 public:
  TableEdit() : token_(NextToken()) {}
  std::uint64_t token() const { return token_; }

 private:
  static std::uint64_t NextToken() {
    static std::atomic<std::uint64_t> next{1};
    return next.fetch_add(1, std::memory_order_relaxed);
  }
  std::uint64_t token_;
};

template <class IdType, class T>
class Table {
 public:
  using Pointer = std::shared_ptr<const T>;

  std::size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }

  // Null if there is no such entry. The value lives as long as any table that holds it.
  const T* Find(IdType id) const { return FindPointer(id).get(); }
  const Pointer& FindPointer(IdType id) const {
    static const Pointer none;
    const std::uint32_t key = id.value();
    if (const Node* leaf = FindLeaf(key)) return leaf->values[key & kMask];
    return source_ ? source_->Find(key) : none;
  }
  bool Contains(IdType id) const { return Find(id) != nullptr; }

  // Sets (or with null, removes) an entry of this table; other copies keep what they had.
  void Set(IdType id, Pointer value, const TableEdit& edit) {
    const std::uint32_t key = id.value();
    if (!root_) {
      if (!value && !source_) return;
      root_ = std::make_shared<Node>(edit.token());
      depth_ = 1;
      FillFromSource(0, root_.get());
    }
    while (depth_ < kMaxDepth && (key >> (kBits * depth_)) != 0) {
      auto taller = std::make_shared<Node>(edit.token());
      taller->children[0] = std::move(root_);
      root_ = std::move(taller);
      ++depth_;
    }
    Node* node = Own(root_, edit);
    for (int level = depth_ - 1; level > 0; --level) {
      auto& child = node->children[(key >> (kBits * level)) & kMask];
      if (!child) {
        if (!value && !source_) return;
        child = std::make_shared<Node>(edit.token());
        if (level == 1) FillFromSource(key, child.get());
      }
      node = Own(child, edit);
    }
    Pointer& slot = node->values[key & kMask];
    if (value && !slot) ++size_;
    if (!value && slot) --size_;
    slot = std::move(value);
  }

  // Calls visit(const Pointer&) for every entry, in the order of ids.
  template <class Visit>
  void ForEach(Visit&& visit) const {
    if (source_) {
      for (std::uint64_t leaf = 0; leaf < NumLeaves(); ++leaf) WalkLeaf(static_cast<std::uint32_t>(leaf), visit);
    } else if (root_) {
      Walk(*root_, depth_ - 1, visit);
    }
  }

  // Calls visit(const Pointer& here, const Pointer& there) where two tables do not hold the same object, in the order
  // of ids; null: there is none. What they share is passed over as a whole: of two tables one of which was made from
  // the other, the cost is in proportion to what was changed.
  template <class Visit>
  void ForEachDifference(const Table& other, Visit&& visit) const {
    if (source_ || other.source_) return WalkDifferingLeaves(other, visit);
    const Subtree here{root_.get(), depth_ - 1}, there{other.root_.get(), other.depth_ - 1};
    WalkDifference(here, there, here.level > there.level ? here.level : there.level, visit);
  }

  // The table of all that is in `source`.
  static Table Over(std::shared_ptr<const TableSource<T>> source) {
    Table table;
    table.size_ = source->size();
    table.source_ = std::move(source);
    return table;
  }
  // The same values over another source of the same.
  Table WithSource(std::shared_ptr<const TableSource<T>> source) const {
    Table table = *this;
    table.source_ = std::move(source);
    return table;
  }

 private:
  static constexpr int kBits = 5;
  static constexpr std::uint32_t kMask = (1u << kBits) - 1;
  static constexpr int kMaxDepth = 7;  // 7 * 5 bits cover a 32-bit id

  // A leaf uses `values`, an inner node `children`.
  struct Node {
    explicit Node(std::uint64_t edit_token) : token(edit_token) {}
    std::uint64_t token;
    std::array<std::shared_ptr<Node>, 1u << kBits> children;
    std::array<Pointer, 1u << kBits> values;
  };

  // Null: none of its values is in the tree.
  const Node* FindLeaf(std::uint32_t key) const {
    if (!root_ || (depth_ < kMaxDepth && (key >> (kBits * depth_)) != 0)) return nullptr;
    const Node* node = root_.get();
    for (int level = depth_ - 1; level > 0 && node != nullptr; --level) {
      node = node->children[(key >> (kBits * level)) & kMask].get();
    }
    return node;
  }

  // A new leaf, around `key`.
  void FillFromSource(std::uint32_t key, Node* leaf) const {
    if (!source_) return;
    for (std::uint32_t i = 0; i <= kMask; ++i) leaf->values[i] = source_->Find((key & ~kMask) | i);
  }

  // Leaves, of the tree or the source, that may hold something.
  std::uint64_t NumLeaves() const {
    const std::uint64_t in_tree = root_ ? std::uint64_t{1} << (kBits * (depth_ - 1)) : 0;
    const std::uint64_t in_source = source_ ? (std::uint64_t{source_->end()} + kMask) >> kBits : 0;
    return in_tree > in_source ? in_tree : in_source;
  }

  template <class Visit>
  void WalkLeaf(std::uint32_t number, Visit& visit) const {
    const std::uint32_t first = number << kBits;
    const Node* leaf = FindLeaf(first);
    if (leaf == nullptr && (!source_ || first >= source_->end())) return;
    for (std::uint32_t i = 0; i <= kMask; ++i) {
      const Pointer& value = leaf != nullptr ? leaf->values[i] : source_->Find(first + i);
      if (value) visit(value);
    }
  }

  // Of tables one of which, or both, have a source.
  template <class Visit>
  void WalkDifferingLeaves(const Table& other, Visit& visit) const {
    const std::uint64_t end = NumLeaves() > other.NumLeaves() ? NumLeaves() : other.NumLeaves();
    const bool same_below = source_ && other.source_ && source_->content() == other.source_->content();
    for (std::uint64_t number = 0; number < end; ++number) {
      const auto first = static_cast<std::uint32_t>(number << kBits);
      if (FindLeaf(first) == other.FindLeaf(first) && (FindLeaf(first) != nullptr || same_below)) continue;
      for (std::uint32_t i = 0; i <= kMask; ++i) {
        const Pointer& a = FindPointer(IdType(first + i));
        const Pointer& b = other.FindPointer(IdType(first + i));
        if (a != b) visit(a, b);
      }
    }
  }

  static Node* Own(std::shared_ptr<Node>& node, const TableEdit& edit) {
    if (node->token != edit.token()) {
      node = std::make_shared<Node>(*node);
      node->token = edit.token();
    }
    return node.get();
  }

  template <class Visit>
  static void Walk(const Node& node, int level, Visit&& visit) {
    if (level == 0) {
      for (const Pointer& value : node.values) {
        if (value) visit(value);
      }
      return;
    }
    for (const auto& child : node.children) {
      if (child) Walk(*child, level - 1, visit);
    }
  }

  // What lies below a node, which may be lower than the place that it is looked at from: then it is its first child's.
  struct Subtree {
    const Node* node = nullptr;
    int level = 0;

    Subtree Child(std::uint32_t i, int from_level) const {
      if (node == nullptr) return {};
      if (level < from_level) return i == 0 ? *this : Subtree();
      return {node->children[i].get(), level - 1};
    }
  };

  template <class Visit>
  static void WalkDifference(const Subtree& here, const Subtree& there, int level, Visit& visit) {
    if (here.node == there.node) return;
    static const Pointer none;
    for (std::uint32_t i = 0; i <= kMask; ++i) {
      if (level > 0) {
        WalkDifference(here.Child(i, level), there.Child(i, level), level - 1, visit);
        continue;
      }
      const Pointer& a = here.node != nullptr ? here.node->values[i] : none;
      const Pointer& b = there.node != nullptr ? there.node->values[i] : none;
      if (a != b) visit(a, b);
    }
  }

  std::shared_ptr<const TableSource<T>> source_;
  std::shared_ptr<Node> root_;
  int depth_ = 0;
  std::size_t size_ = 0;
};

}  // namespace cairn::map
