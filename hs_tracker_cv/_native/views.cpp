#include "views.hpp"

#include <cstring>

namespace nb = nanobind;

namespace hs {
namespace {

std::string sizes_text(int count, const Py_ssize_t *sizes) {
    std::string text = "(";
    for (int i = 0; i < count; ++i) {
        text += sizes[i] < 0 ? std::string("any") : std::to_string(sizes[i]);
        text += i + 1 < count || count == 1 ? "," : "";
        text += i + 1 < count ? " " : "";
    }
    return text + ")";
}

// Whether the bytes of a number lie as this processor wants them, by the prefix of its format.
bool is_native(char prefix) {
    const std::uint16_t one = 1;
    const bool little = *reinterpret_cast<const unsigned char *>(&one) == 1;
    return prefix == '@' || prefix == '=' || prefix == (little ? '<' : '>');
}

} // namespace

std::string type_name(const char *format, Py_ssize_t item_size) {
    const char *code = format ? format : "B";
    if (std::strchr("@=<>!", *code)) {
        if (!is_native(*code)) return std::string("format '") + format + "'";
        ++code;
    }
    const char *kind = nullptr;
    if (*code && !code[1]) {
        kind = std::strchr("efdg", *code)     ? "float"
               : std::strchr("bhilqn", *code) ? "int"
               : std::strchr("BHILQN", *code) ? "uint"
               : *code == '?'                 ? "bool"
                                              : nullptr;
    }
    if (!kind) return std::string("format '") + format + "'";
    return *code == '?' ? "bool" : kind + std::to_string(8 * item_size);
}

std::string Buffer::expected() const {
    return std::string("expected ") + name_ + " to be an array of " + type_ + " with " + std::to_string(dimensions_) +
           " dimensions";
}

Buffer::Buffer(nb::handle object, const char *name, const char *type, int dimensions, bool writable)
    : name_(name), type_(type), dimensions_(dimensions) {
    if (PyObject_GetBuffer(object.ptr(), &view_, PyBUF_STRIDES | PyBUF_FORMAT)) {
        PyErr_Clear();
        throw nb::type_error((expected() + ", got " + nb::type_name(object.type()).c_str()).c_str());
    }
    const std::string given = type_name(view_.format, view_.itemsize);
    std::string wrong;
    const bool other_type = given != type;
    if (other_type)
        wrong = given;
    else if (view_.ndim != dimensions)
        wrong = "shape " + sizes_text(view_.ndim, view_.shape);
    else if (!PyBuffer_IsContiguous(&view_, 'C'))
        wrong = "one that is not C-contiguous";
    else if (reinterpret_cast<std::uintptr_t>(view_.buf) % view_.itemsize)
        wrong = "one at an address that is no multiple of its elements' size";
    else if (writable && view_.readonly)
        wrong = "a read-only one";
    if (wrong.empty()) return;
    PyBuffer_Release(&view_); // the destructor does not run
    wrong = expected() + ", got " + wrong;
    if (other_type) throw nb::type_error(wrong.c_str());
    throw nb::value_error(wrong.c_str());
}

void Buffer::expect_writable() const {
    if (view_.readonly) throw nb::value_error((expected() + ", got a read-only one").c_str());
}

void Buffer::expect(std::initializer_list<Py_ssize_t> sizes) const {
    int axis = 0;
    for (const Py_ssize_t size : sizes) {
        if (size >= 0 && view_.shape[axis] != size) {
            const std::string text = std::string("expected ") + name_ + " to have shape " +
                                     sizes_text(static_cast<int>(sizes.size()), sizes.begin()) + ", got " +
                                     sizes_text(view_.ndim, view_.shape);
            throw nb::value_error(text.c_str());
        }
        ++axis;
    }
}

} // namespace hs
