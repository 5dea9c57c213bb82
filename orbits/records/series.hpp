#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"
#include "models/definition/parameter.hpp"
#include "orbits/records/readings.hpp"

#pragma GCC visibility push(default)

namespace orbid::orbits {

/// A coordinate of a series: it owns its name and unit, which may come from a file.
struct SeriesCoordinate {
    std::string name;
    std::string unit;
    bool angle = false;
};

/// One uninterrupted piece of a record. Successive columns are one section or one sampling interval apart.
struct Segment {
    std::string label;      ///< as in the file, or the index
    Readings values;        ///< shape (n, m); nan = missing sample; angles as read (not wrapped by the series)
    Eigen::VectorXd times;  ///< shape (m) [s] for samples and crossings of autonomous flows; else empty
    /// Known sd of every value, in its unit, shape (n, m): > 0, nan where none is known. Empty: none is known.
    Eigen::MatrixXd deviations = {};
    /// Of crossings: known sd of every time [s], shape (m), and the rates at which the coordinates change there, shape
    /// (n, m). An error dt of a time moves the coordinates by rates dt, which is part of `deviations`. Empty: not
    /// known.
    Eigen::VectorXd time_deviations = {};
    Eigen::MatrixXd rates = {};
};

/// A measured or simulated record.
struct Series {
    enum class Sampling { section, samples };

    Sampling sampling = Sampling::section;
    std::vector<SeriesCoordinate> coordinates;
    std::vector<Segment> segments;
    double phase = 0.0;  ///< [rad] phase of the forcing: of the section, or at time 0 of samples
    std::string origin;  ///< what made it: one line of free text, stored in files; may be empty

    [[nodiscard]] Eigen::Index dimension() const { return static_cast<Eigen::Index>(coordinates.size()); }
    [[nodiscard]] const SeriesCoordinate& coordinate(Eigen::Index i) const {
        return coordinates[static_cast<std::size_t>(i)];
    }
    [[nodiscard]] std::size_t size() const;  ///< points of all segments
    /// Every point has a time: samples, and sections whose crossings were timed.
    [[nodiscard]] bool timed() const;

    /// Size of each coordinate's range: 2 pi for angles, the central 99.8 % range otherwise (mathematics.md, section
    /// 2). Missing samples are left out; 1 for a coordinate that never changes or was never read. Distances between
    /// states are in these units. Shape (n).
    [[nodiscard]] Eigen::VectorXd scale() const;
};

}  // namespace orbid::orbits

#pragma GCC visibility pop
