// Arrays of Python as C++ sees them. Everything a kernel relies on is checked here, once, when it is called.
#pragma once

#include <nanobind/nanobind.h>

#include <array>
#include <cstdint>
#include <string>

namespace hs {

// Name of a buffer's element type for messages, such as "float32"; formats that have none are given as they are.
std::string type_name(const char *format, Py_ssize_t item_size);

// A C-contiguous array of `dimensions` dimensions and native elements, held while this object lives.
//
// T is the element type: `const` for what is read, plain for what is written, which must be writable. Nothing is ever
// converted or copied. Errors name the argument: TypeError for what is no array or has other elements, ValueError for
// another number of dimensions or layout, and for read-only memory.
class Buffer {
  public:
    Buffer(nanobind::handle object, const char *name, const char *type, int dimensions, bool writable);
    ~Buffer() { PyBuffer_Release(&view_); }
    Buffer(const Buffer &) = delete;
    Buffer &operator=(const Buffer &) = delete;

    Py_ssize_t size(int axis) const { return view_.shape[axis]; }
    void *data() const { return view_.buf; }

    // ValueError unless the array has these sizes; -1 allows any.
    void expect(std::initializer_list<Py_ssize_t> sizes) const;
    // ValueError unless it may be written.
    void expect_writable() const;

  private:
    std::string expected() const;

    Py_buffer view_;
    const char *name_, *type_;
    int dimensions_;
};

template <class T> constexpr const char *type_of();
template <> constexpr const char *type_of<float>() { return "float32"; }
template <> constexpr const char *type_of<double>() { return "float64"; }
template <> constexpr const char *type_of<std::uint8_t>() { return "uint8"; }
template <> constexpr const char *type_of<std::int16_t>() { return "int16"; }
template <> constexpr const char *type_of<std::int32_t>() { return "int32"; }
template <> constexpr const char *type_of<std::int64_t>() { return "int64"; }

template <class T, int Dimensions> class Array : public Buffer {
  public:
    Array(nanobind::handle object, const char *name)
        : Buffer(object, name, type_of<std::remove_const_t<T>>(), Dimensions, !std::is_const_v<T>) {}
    // Of these sizes; -1 allows any.
    Array(nanobind::handle object, const char *name, std::initializer_list<Py_ssize_t> sizes) : Array(object, name) {
        expect(sizes);
    }
    T *data() const { return static_cast<T *>(Buffer::data()); }
};

// An array of a struct, which one kernel reads and another writes.
template <class T, int Dimensions> class Field : public Array<const T, Dimensions> {
  public:
    using Array<const T, Dimensions>::Array;
    T *out() const {
        this->expect_writable();
        return static_cast<T *>(Buffer::data());
    }
};

} // namespace hs
