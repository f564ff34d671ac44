// Large objects that are used again: who holds the pointer owns the object, and when the last one lets go of it, in
// whatever thread, it comes back to the pool under the pool's lock. Once as many as are ever needed at a time exist,
// taking one allocates nothing.
#pragma once

#include <cstddef>
#include <memory>
#include <mutex>
#include <new>
#include <utility>
#include <vector>

namespace cairn {

template <class T>
class ObjectPool {
 public:
  ObjectPool() : idle_(std::make_shared<Idle>()) {}

  // One that came back, as it was left, or a new one. It may outlive the pool. From any thread.
  std::shared_ptr<T> Take() {
    std::unique_ptr<T> object;
    {
      std::lock_guard lock(idle_->mutex);
      if (!idle_->objects.empty()) {
        object = std::move(idle_->objects.back());
        idle_->objects.pop_back();
      }
    }
    if (!object) object = std::make_unique<T>();
    auto loan = std::allocate_shared<Loan>(Blocks<Loan>{idle_}, idle_, std::move(object));
    T* const lent = loan->object.get();
    return std::shared_ptr<T>(std::move(loan), lent);
  }

  // Frees what nobody holds.
  void Trim() {
    std::vector<std::unique_ptr<T>> freed;  // without the lock
    std::lock_guard lock(idle_->mutex);
    freed.swap(idle_->objects);
  }

  std::size_t idle() const {
    std::lock_guard lock(idle_->mutex);
    return idle_->objects.size();
  }

 private:
  // What is not in use: the objects, and the memory of reference counts, all of one size.
  struct Idle {
    std::mutex mutex;
    std::vector<std::unique_ptr<T>> objects;
    std::vector<void*> blocks;

    ~Idle() {
      for (void* block : blocks) ::operator delete(block);
    }
  };

  struct Loan {
    Loan(std::shared_ptr<Idle> to, std::unique_ptr<T> what) : idle(std::move(to)), object(std::move(what)) {}
    ~Loan() {
      try {
        std::lock_guard lock(idle->mutex);
        idle->objects.push_back(std::move(object));
      } catch (...) {  // no memory to remember it: it is freed
      }
    }
    Loan(const Loan&) = delete;
    Loan& operator=(const Loan&) = delete;

    std::shared_ptr<Idle> idle;
    std::unique_ptr<T> object;
  };

  template <class U>
  struct Blocks {
    using value_type = U;
    std::shared_ptr<Idle> idle;

    explicit Blocks(std::shared_ptr<Idle> of) : idle(std::move(of)) {}
    template <class V>
    Blocks(const Blocks<V>& other) : idle(other.idle) {}  // NOLINT: allocators convert

    U* allocate(std::size_t) {  // always of one reference count with its loan
      static_assert(alignof(U) <= __STDCPP_DEFAULT_NEW_ALIGNMENT__);
      std::lock_guard lock(idle->mutex);
      if (idle->blocks.empty()) return static_cast<U*>(::operator new(sizeof(U)));
      void* const block = idle->blocks.back();
      idle->blocks.pop_back();
      return static_cast<U*>(block);
    }
    void deallocate(U* block, std::size_t) {
      try {
        std::lock_guard lock(idle->mutex);
        idle->blocks.push_back(block);
      } catch (...) {
        ::operator delete(block);
      }
    }
    template <class V>
    bool operator==(const Blocks<V>& other) const {
      return idle == other.idle;
    }
  };

  const std::shared_ptr<Idle> idle_;
};

}  // namespace cairn
