#pragma once

#include <memory>
#include <new>
#include <utility>

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"

namespace orbid::orbits {

/// The readings of a segment, shape (n, m): a matrix that owns its numbers or views numbers owned elsewhere.
///
/// Used like an Eigen::MatrixXd. Copies of borrowed readings view the same numbers and keep their owner alive. A record
/// that another part of the program holds in memory is therefore never copied. Readings own the values of an expression
/// assigned to them. Do not write to elements of borrowed readings: others may be viewing them.
class Readings : public Eigen::Map<Eigen::MatrixXd> {
    using View = Eigen::Map<Eigen::MatrixXd>;

public:
    Readings() : View(nullptr, 0, 0) {}
    Readings(Eigen::MatrixXd values)  // NOLINT: a matrix is a set of readings
        : View(nullptr, 0, 0), own_(std::move(values)) {
        look_at(own_.data(), own_.rows(), own_.cols());
    }
    template <class Expression>
    Readings(const Eigen::EigenBase<Expression>& values)  // NOLINT: likewise
        : Readings(Eigen::MatrixXd(values.derived())) {}
    Readings(Eigen::Index rows, Eigen::Index columns) : Readings(Eigen::MatrixXd(rows, columns)) {}

    /// Views rows * columns numbers, column after column, for as long as `owner` or a copy of it lives.
    [[nodiscard]] static Readings borrowed(const double* values, Eigen::Index rows, Eigen::Index columns,
                                           std::shared_ptr<const void> owner) {
        Readings result;
        result.owner_ = std::move(owner);
        result.look_at(const_cast<double*>(values), rows, columns);  // NOLINT: only read, see above
        return result;
    }
    /// The owner of borrowed numbers; null when the readings own them.
    [[nodiscard]] const std::shared_ptr<const void>& owner() const { return owner_; }

    Readings(const Readings& other) : View(nullptr, 0, 0), own_(other.own_), owner_(other.owner_) { look_like(other); }
    Readings(Readings&& other) noexcept
        : View(nullptr, 0, 0), own_(std::move(other.own_)), owner_(std::move(other.owner_)) {
        look_like(other);
        other.look_at(nullptr, 0, 0);
    }
    Readings& operator=(const Readings& other) {
        if (this != &other) *this = Readings(other);
        return *this;
    }
    Readings& operator=(Readings&& other) noexcept {
        own_ = std::move(other.own_);
        owner_ = std::move(other.owner_);
        look_like(other);
        if (this != &other) other.look_at(nullptr, 0, 0);
        return *this;
    }
    template <class Expression>
    Readings& operator=(const Eigen::EigenBase<Expression>& values) {
        return *this = Readings(values);
    }
    ~Readings() = default;

    void resize(Eigen::Index rows, Eigen::Index columns) {
        if (rows != this->rows() || columns != cols()) *this = Readings(rows, columns);
    }
    void conservativeResize(Eigen::Index rows, Eigen::NoChange_t) {
        Eigen::MatrixXd values = *this;
        values.conservativeResize(rows, Eigen::NoChange);
        *this = Readings(std::move(values));
    }

private:
    /// Constructs a view in place of the present one, as Eigen does for its maps.
    void look_at(double* values, Eigen::Index rows, Eigen::Index columns) {
        new (static_cast<View*>(this)) View(values, rows, columns);
    }
    void look_like(const Readings& other) {
        look_at(owner_ ? const_cast<double*>(other.View::data()) : own_.data(), other.rows(), other.cols());
    }

    Eigen::MatrixXd own_;
    std::shared_ptr<const void> owner_;
};

}  // namespace orbid::orbits
