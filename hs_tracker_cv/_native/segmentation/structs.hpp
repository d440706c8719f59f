// What Python hands to the kernels of segmentation: arrays that belong together, checked when a struct is made of them.
//
// A kernel that writes asks for `out`, which wants the array to be writable; what it reads may be read-only.
#pragma once

#include "../levels.hpp"
#include "../views.hpp"

#include <array>
#include <optional>

namespace hs {

using Handle = nanobind::handle;
using Image = Array<const float, 3>;
using Plane2 = Array<const float, 2>;
using Mask = Array<const Byte, 2>;
using Numbers = Array<const double, 1>;
using ImageOut = Array<float, 3>;
using PlaneOut = Array<float, 2>;
using MaskOut = Array<Byte, 2>;
using NumbersOut = Array<double, 1>;
using Pair2 = std::array<double, 2>;
using GridNumbers = std::array<double, 4>;

constexpr Index MOST_REACH = 1 << 16; // px
constexpr Index MOST_STEPS = 1000;

[[noreturn]] void refuse(const std::string &message);

// ValueError unless it is a window's.
Size checked_size(Size size, const char *name);
// The size of a window, by one of its arrays.
Size checked_size(const Buffer &array, const char *name);
// ValueError unless it is that of the window; `name` is of what has another.
void expect_size(Size size, Size window, const char *name);
// (x0, y0, x1, y1) of a part of a window; nothing if x1 < x0 or y1 < y0.
Rectangle checked_part(Handle object, const char *name, Size size);
Index checked_count(Index value, const char *name, Index least, Index most);
Grid checked_grid(const GridNumbers &grid);

// An optional mask of a window's size.
class OptionalMask {
  public:
    OptionalMask(Handle object, const char *name, Size size) {
        if (!object.is_none()) mask_.emplace(object, name, std::initializer_list<Py_ssize_t>{size.height, size.width});
    }
    const Byte *data() const { return mask_ ? mask_->data() : nullptr; }

  private:
    std::optional<Mask> mask_;
};

// This frame in the window, and the part of it inside the frame.
class BoundWindow {
  public:
    BoundWindow(Handle image, Handle inside);
    Size size() const { return size_; }
    const float *image() const { return image_.data(); }
    const Rectangle &inside() const { return inside_; }

  private:
    Image image_;
    Size size_;
    Rectangle inside_;
};

// The background: its image, and its counts.
class BoundGround {
  public:
    BoundGround(Handle image, Handle counts);
    Size size() const { return {image_.size(0), image_.size(1)}; }
    Ground ground() const { return {image_.data(), counts_.data()}; }
    float *image_out() const { return image_.out(); }
    float *counts_out() const { return counts_.out(); }

  private:
    Field<float, 3> image_, counts_;
};

// This frame, and the images that explain it: the background, and the last frame moved by the camera.
class BoundScene {
  public:
    BoundScene(Handle image, Handle inside, Handle moved, Handle background, Handle counts);
    Size size() const { return window_.size(); }
    const float *image() const { return window_.image(); }
    const Rectangle &inside() const { return window_.inside(); }
    Ground ground() const { return {background_.data(), counts_.data()}; }
    Explanations with(const float *carried, const float *object, const float *odds) const {
        return {image(), background_.data(), moved_.data(), carried, object, odds, counts_.data()};
    }

  private:
    BoundWindow window_;
    Image moved_, background_, counts_;
};

// What is known of the object: its image, log-odds and slow shape.
class BoundLayer {
  public:
    BoundLayer(Handle image, Handle odds, Handle shape);
    Size size() const { return {odds_.size(0), odds_.size(1)}; }
    Object object(const float *previous) const { return {previous, image_.data(), odds_.data(), shape_.data()}; }
    float *image_out() const { return image_.out(); }
    float *odds_out() const { return odds_.out(); }
    float *shape_out() const { return shape_.out(); }

  private:
    Field<float, 3> image_;
    Field<float, 2> odds_, shape_;
};

// The same where it is expected in this frame, with the last frame moved along and {log-odds > 0}; and the part of the
// window in which it has been moved.
class BoundExpected {
  public:
    BoundExpected(Handle previous, Handle image, Handle odds, Handle shape, Handle own, Handle part);
    Size size() const { return layer_.size(); }
    Object object() const { return layer_.object(previous_.data()); }
    const Byte *own() const { return own_.data(); }
    const Rectangle &part() const { return part_; }
    MovedObject out() const {
        return {previous_.out(), layer_.image_out(), layer_.odds_out(), layer_.shape_out(), own_.out()};
    }

  private:
    BoundLayer layer_;
    Field<float, 3> previous_;
    Field<Byte, 2> own_;
    Rectangle part_;
};

// Planes of `evidence`, and where something is new.
class BoundEvidence {
  public:
    BoundEvidence(Handle planes, Handle fresh);
    Size size() const { return {fresh_.size(0), fresh_.size(1)}; }
    float *planes_out() const { return planes_.out(); }
    const Byte *fresh() const { return fresh_.data(); }
    Evidence out() const { return {planes_.out(), fresh_.out()}; }

  private:
    Field<float, 3> planes_;
    Field<Byte, 2> fresh_;
};

// What `label` writes; there may be no distractor.
class BoundLabels {
  public:
    BoundLabels(Handle bins, Handle raw, Handle odds, Handle mask, Handle foreign);
    Size size() const { return {mask_.size(0), mask_.size(1)}; }
    const std::int16_t *bins() const { return bins_.data(); }
    const float *raw() const { return raw_.data(); }
    const float *odds() const { return odds_.data(); }
    const Byte *mask() const { return mask_.data(); }
    const Byte *foreign() const { return foreign_ ? foreign_->data() : nullptr; }
    Labels out() const;

  private:
    Field<Byte, 2> mask_;
    Field<std::int16_t, 2> bins_;
    Field<float, 2> raw_, odds_;
    std::optional<Field<Byte, 2>> foreign_;
};

// What is remembered after a frame.
class BoundMemory {
  public:
    BoundMemory(Handle odds, Handle object, Handle shape, Handle background, Handle counts, Handle colours)
        : layer_(object, odds, shape), ground_(background, counts), colours_(colours, "colours", {2, BINS}) {
        expect_size(ground_.size(), layer_.size(), "background");
    }
    Size size() const { return layer_.size(); }
    Memory out() const {
        return {layer_.odds_out(),   layer_.image_out(),   layer_.shape_out(),
                ground_.image_out(), ground_.counts_out(), colours_.out()};
    }

  private:
    BoundLayer layer_;
    BoundGround ground_;
    Field<float, 2> colours_;
};

// Listed points, see `collect`; so many of them are in use.
class BoundPoints {
  public:
    BoundPoints(Handle rows, Index count)
        : rows_(rows, "rows", {POINT_ROWS, -1}), count_(checked_count(count, "count", 0, rows_.size(1))) {}
    Index count() const { return count_; }
    Points points() const { return {const_cast<float *>(rows_.data()), rows_.size(1), count_}; }
    Points empty() const { return {rows_.out(), rows_.size(1), 0}; }
    void use(Index count) { count_ = count; }

  private:
    Field<float, 2> rows_;
    Index count_;
};

// The object's pixels before this frame, and what they weigh; a grid to fall back on.
class BoundOutline {
  public:
    BoundOutline(Handle odds, Handle shown, int weighing, const GridNumbers &box);
    Size size() const { return size_; }
    const float *odds() const { return odds_.data(); }
    const Byte *shown() const { return shown_.data(); }
    Weighing weighing() const { return weighing_; }
    const Grid &box() const { return box_; }

  private:
    Plane2 odds_;
    Size size_;
    OptionalMask shown_;
    Weighing weighing_;
    Grid box_;
};

// How object and camera moved in the last frame.
struct LastMotion {
    std::array<double, 6> object; // velocity (2) and linear part (4)
    Pair2 camera;
    bool known; // the object's is as it was, whatever the image says
};

// What is known before the flow is.
class BoundPrediction {
  public:
    BoundPrediction(Handle near, Handle weight, Handle theta, Handle flow);
    Size size() const { return {near_.size(0), near_.size(1)}; }
    const Byte *near() const { return near_.data(); }
    const float *weight() const { return weight_.data(); }
    const double *theta() const { return theta_.data(); }
    Predicted out(const Points &points) const {
        return {near_.out(), weight_.out(), points, theta_.out(), flow_.out(), {}, {}, 0.0, 0.0};
    }

  private:
    Field<Byte, 2> near_;
    Field<float, 2> weight_;
    Field<double, 1> theta_;
    Field<float, 3> flow_;
};

// How motion is measured, see Measurement.
struct Measuring {
    Grid grid;
    Pair2 camera, offset;
    double noise;
    bool hidden, young;
    Index ground_steps, steps;
};

// How a frame is labelled, see Labelling.
class BoundLabelling {
  public:
    BoundLabelling(Handle colours, double colour_weight, double noise, double least, Index growth, bool emerging,
                   bool young);
    Labelling with(const BoundScene &scene, const BoundExpected &expected, const BoundEvidence &seen,
                   const OptionalMask &before, const OptionalMask &hiding) const;

  private:
    Plane2 colours_;
    double colour_weight_, noise_, least_;
    Index growth_;
    bool emerging_, young_;
};

// How a frame is learned from, see Lesson.
class BoundLearning {
  public:
    BoundLearning(Handle colours, float shape_rate, double colour_rate, bool freeze, bool hidden)
        : colours_(colours, "colours", {2, BINS}), shape_rate_(shape_rate), colour_rate_(colour_rate), freeze_(freeze),
          hidden_(hidden) {}
    Lesson with(const BoundWindow &window, const Image &aligned, const BoundExpected &expected, const Image &planes,
                const BoundLabels &labels, const BoundGround &ground) const;

  private:
    Plane2 colours_;
    float shape_rate_;
    double colour_rate_;
    bool freeze_, hidden_;
};

// How points are registered, see Registration.
class BoundRegistration {
  public:
    BoundRegistration(Handle prior, double scale, double ceiling, double stiffness, Index steps)
        : prior_(prior, "prior", {THETA}), scale_(scale), ceiling_(ceiling), stiffness_(stiffness),
          steps_(checked_count(steps, "steps", 0, MOST_STEPS)) {}
    Registration view() const { return {prior_.data(), scale_, ceiling_, stiffness_, steps_}; }

  private:
    Numbers prior_;
    double scale_, ceiling_, stiffness_;
    Index steps_;
};

void bind_structs(nanobind::module_ &module);

} // namespace hs
