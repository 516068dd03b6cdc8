// SPDX-FileCopyrightText: 2026 The terrain_estimator authors
// SPDX-License-Identifier: Apache-2.0
//
// Tensors with PyTorch's semantics, in plain C++ and without a library.
//
// All numbers are held as double; a tensor's kind says what they mean (truth values and integers
// below 2^53 are exact). Views share memory, as in PyTorch. One thread at a time.

#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <initializer_list>
#include <optional>
#include <stdexcept>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

namespace terrain {

enum class Kind : uint8_t { kBoolean, kInteger, kSingle, kReal };  // in order of promotion

[[noreturn]] inline void fail(const char* what) { throw std::runtime_error(what); }

inline void require(bool holds, const char* what) {
  if (!holds) fail(what);
}

// Blocks of memory by powers of two, which are kept and given out again.
class Pool {
 public:
  static void* take(size_t bytes, int& place) {
    place = bytes <= 64 ? 6 : 64 - __builtin_clzll(bytes - 1);
    Block* block = pool_.free_[place];
    if (!block) return ::operator new(size_t{1} << place);
    pool_.free_[place] = block->next;
    return block;
  }
  static void give_back(void* block, int place) {
    pool_.free_[place] = new (block) Block{pool_.free_[place]};
  }

 private:
  struct Block {
    Block* next;
  };
  ~Pool() {
    for (Block* block : free_)
      while (block) {
        Block* next = block->next;
        ::operator delete(block);
        block = next;
      }
  }
  Block* free_[48] = {};
  static Pool pool_;
};
inline Pool Pool::pool_;

// A pointer to a T that counts its references in T::references.
template <class T>
class Shared {
 public:
  Shared() = default;
  explicit Shared(T* target) : target_(target) {}
  Shared(const Shared& other) : target_(other.target_) {
    if (target_) ++target_->references;
  }
  Shared(Shared&& other) noexcept : target_(other.target_) { other.target_ = nullptr; }
  Shared& operator=(Shared other) noexcept {
    std::swap(target_, other.target_);
    return *this;
  }
  ~Shared() {
    if (target_ && --target_->references == 0) target_->release();
  }
  T* operator->() const { return target_; }
  T& operator*() const { return *target_; }
  explicit operator bool() const { return target_ != nullptr; }

 private:
  T* target_ = nullptr;
};

struct Storage {
  int references, place;
  double* data() { return reinterpret_cast<double*>(this + 1); }
  static Shared<Storage> of(int64_t count) {
    static_assert(sizeof(Storage) == 8);
    int place;
    auto* block = static_cast<Storage*>(Pool::take(8 + 8 * static_cast<size_t>(count), place));
    block->references = 1;
    block->place = place;
    return Shared<Storage>(block);
  }
  void release() { Pool::give_back(this, place); }
};

constexpr int kMostDimensions = 8;

// A short list of integers, such as the sizes of a tensor.
class Integers {
 public:
  Integers() = default;
  Integers(std::initializer_list<int64_t> values) {
    for (int64_t value : values) append(value);
  }
  int64_t operator[](int64_t place) const { return data()[checked(place)]; }
  int64_t& operator[](int64_t place) { return data()[checked(place)]; }
  int64_t count() const { return count_; }
  const int64_t* begin() const { return data(); }
  const int64_t* end() const { return data() + count_; }
  void append(int64_t value) {
    if (count_ < kInline && many_.empty()) {
      few_[count_++] = value;
      return;
    }
    if (many_.empty()) many_.assign(few_, few_ + count_);
    many_.push_back(value);
    ++count_;
  }

 private:
  static constexpr int64_t kInline = kMostDimensions;
  const int64_t* data() const { return many_.empty() ? few_ : many_.data(); }
  int64_t* data() { return many_.empty() ? few_ : many_.data(); }
  int64_t checked(int64_t place) const {
    if (place < 0) place += count_;
    require(place >= 0 && place < count_, "a list has no such place");
    return place;
  }
  int64_t count_ = 0, few_[kInline];
  std::vector<int64_t> many_;
};

// A tensor without its memory.
struct View {
  int references = 1, place = 0, dimensions = 0;
  Kind kind = Kind::kReal;
  bool dense = false;  // known to be contiguous
  Shared<Storage> storage;
  double* data = nullptr;
  int64_t count = 1;  // of elements
  int32_t sizes[kMostDimensions], strides[kMostDimensions];

  static View* fresh() {
    int place;
    auto* view = new (Pool::take(sizeof(View), place)) View;
    view->place = place;
    return view;
  }
  __attribute__((noinline)) void release() {
    const int own = place;
    this->~View();
    Pool::give_back(this, own);
  }
};

// A number with its kind.
struct Scalar {
  double value;
  Kind kind;
  Scalar(double v) : value(v), kind(Kind::kReal) {}
  Scalar(int64_t v) : value(static_cast<double>(v)), kind(Kind::kInteger) {}
  Scalar(int v) : value(v), kind(Kind::kInteger) {}
  Scalar(bool v) : value(v), kind(Kind::kBoolean) {}
};

class Tensor {
 public:
  Tensor() = default;  // undefined: Python's None
  explicit Tensor(View* view) : view_(view) {}

  // Uninitialised memory.
  template <class Sizes>
  static Tensor empty(const Sizes& sizes, Kind kind) {
    View* view = View::fresh();
    Tensor made(view);
    view->kind = kind;
    for (int64_t size : sizes) {
      require(size >= 0 && size < (int64_t{1} << 31), "a size is out of range");
      made.add_dimension(size, 0);
    }
    made.lay_out();
    return made;
  }
  static Tensor empty_like(const Tensor& other, Kind kind) {
    View* view = View::fresh();
    Tensor made(view);
    view->kind = kind;
    view->dimensions = other.dimensions();
    view->count = other.count();
    std::copy(other.view_->sizes, other.view_->sizes + view->dimensions, view->sizes);
    made.lay_out();
    return made;
  }
  static Tensor of(Scalar value) {
    Tensor made = empty(Integers(), value.kind);
    *made.data() = value.value;
    return made;
  }
  static Tensor of(const double* values, std::initializer_list<int64_t> sizes, Kind kind) {
    Tensor made = empty(sizes, kind);
    std::memcpy(made.data(), values, 8 * static_cast<size_t>(made.count()));
    return made;
  }

  // The sizes as a range.
  struct Extent {
    const int32_t* first;
    int length;
    const int32_t* begin() const { return first; }
    const int32_t* end() const { return first + length; }
  };
  Extent extent() const { return {view_->sizes, view_->dimensions}; }

  bool defined() const { return static_cast<bool>(view_); }
  int dimensions() const { return view_->dimensions; }
  Kind kind() const { return view_->kind; }
  double* data() const { return view_->data; }
  int64_t size(int d) const { return view_->sizes[d]; }
  int64_t stride(int d) const { return view_->strides[d]; }
  int64_t count() const { return view_->count; }
  bool contiguous() const {
    if (view_->dense || count() == 0) return true;
    int64_t expected = 1;
    for (int d = dimensions() - 1; d >= 0; --d) {
      if (size(d) != 1 && stride(d) != expected) return false;
      expected *= size(d);
    }
    return true;
  }
  int place_of(int64_t dimension, int more = 0) const {
    const int n = dimensions() + more;
    if (dimension < 0) dimension += n;
    require(dimension >= 0 && (dimension < n || (n == 0 && dimension == 0)),
            "a tensor has no such dimension");
    return static_cast<int>(dimension);
  }
  double item() const {
    require(count() == 1, "only a tensor of one element is a number");
    return *data();
  }

  // A view without dimensions yet, of the same memory.
  Tensor bare() const {
    View* view = View::fresh();
    view->kind = view_->kind;
    view->storage = view_->storage;
    view->data = view_->data;
    return Tensor(view);
  }
  void add_dimension(int64_t size, int64_t stride) {
    require(view_->dimensions < kMostDimensions, "more dimensions than a tensor may have");
    view_->sizes[view_->dimensions] = static_cast<int32_t>(size);
    view_->strides[view_->dimensions++] = static_cast<int32_t>(stride);
    view_->count *= size;
  }
  void move(int64_t offset) { view_->data += offset; }
  void set_kind(Kind kind) { view_->kind = kind; }

 private:
  // Memory of its own, by rows.
  void lay_out() {
    int32_t stride = 1;
    for (int d = dimensions() - 1; d >= 0; --d) {
      view_->strides[d] = stride;
      stride *= std::max(view_->sizes[d], 1);
    }
    view_->dense = true;
    view_->storage = Storage::of(view_->count);
    view_->data = view_->storage->data();
  }

  Shared<View> view_;
};

// A list of anything, by reference, as in Python.
template <class T>
class List {
 public:
  List() : items_(new Items) {}
  List(std::initializer_list<T> values) : List() { items_->values = values; }
  const T& operator[](int64_t place) const {
    if (place < 0) place += count();
    require(place >= 0 && place < count(), "a list has no such place");
    return items_->values[static_cast<size_t>(place)];
  }
  int64_t count() const { return static_cast<int64_t>(items_->values.size()); }
  void append(const T& value) const { items_->values.push_back(value); }
  const T* begin() const { return items_->values.data(); }
  const T* end() const { return begin() + count(); }

 private:
  struct Items {
    int references = 1;
    std::vector<T> values;
    void release() { delete this; }
  };
  Shared<Items> items_;
};

// A dictionary in the order of insertion, by reference, as in Python.
template <class T>
class Dictionary {
 public:
  Dictionary() : items_(new Items) {}
  Dictionary(std::initializer_list<std::pair<int64_t, T>> items) : Dictionary() {
    items_->values = items;
  }
  bool contains(int64_t key) const { return find(key) != nullptr; }
  const T& operator[](int64_t key) const {
    const auto* found = find(key);
    require(found != nullptr, "a dictionary has no such key");
    return found->second;
  }
  void set(int64_t key, const T& value) const {
    if (auto* found = find(key))
      found->second = value;
    else
      items_->values.emplace_back(key, value);
  }
  Dictionary copy() const {
    Dictionary made;
    made.items_->values = items_->values;
    return made;
  }
  Integers keys() const {
    Integers made;
    for (const auto& item : items_->values) made.append(item.first);
    return made;
  }
  const std::vector<std::pair<int64_t, T>>& items() const { return items_->values; }

 private:
  std::pair<int64_t, T>* find(int64_t key) const {
    for (auto& item : items_->values)
      if (item.first == key) return &item;
    return nullptr;
  }
  struct Items {
    int references = 1;
    std::vector<std::pair<int64_t, T>> values;
    void release() { delete this; }
  };
  Shared<Items> items_;
};

}  // namespace terrain
