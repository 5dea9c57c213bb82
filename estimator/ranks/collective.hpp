#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "estimator/ranks/ranks.hpp"

namespace orbid::estimator {

/// Numbers of one message, read in the order in which they were written. Ranks are machines of one kind: the bytes of
/// doubles are sent as they are.
class RankNumbers {
public:
    void put(double value) { values_.push_back(value); }
    void put(std::span<const double> values) { values_.insert(values_.end(), values.begin(), values.end()); }
    /// With its shape.
    void put(const Eigen::MatrixXd& matrix);
    /// @throws std::runtime_error when nothing is left.
    [[nodiscard]] double take();
    [[nodiscard]] Eigen::Index take_index() { return static_cast<Eigen::Index>(take()); }
    [[nodiscard]] Eigen::MatrixXd take_matrix();

private:
    friend class Collective;
    std::vector<double> values_;
    std::size_t at_ = 0;
};

/// What all ranks do together. Every rank calls the same operations in the same order; a message that belongs to
/// another operation is refused.
///
/// Ranks form a binary tree: rank r receives from r + 1, r + 2, r + 4, ... as long as these powers of two divide r, and
/// then sends to what is left of r without its lowest one. A subtree is thus a range of successive ranks, in order.
/// Sums are formed along the tree and sent back from rank 0: they have the same bytes on every rank.
class Collective {
public:
    enum class Operation { sum, tell, neighbours, condense, descend };

    explicit Collective(Ranks& ranks);

    [[nodiscard]] int rank() const { return ranks_.rank(); }
    [[nodiscard]] int count() const { return ranks_.count(); }
    /// The ranks that send to this one, in the order of their ranges.
    [[nodiscard]] const std::vector<int>& children() const { return children_; }
    /// -1 for rank 0.
    [[nodiscard]] int parent() const { return parent_; }

    /// Replaces numbers by their sums over all ranks.
    void sum(std::span<double> values);
    /// Replaces numbers by those of rank 0.
    void tell(std::span<double> values);
    [[nodiscard]] bool any(bool value);

    /// Begins an operation made of send() and receive().
    void begin(Operation operation);
    void send(int to, const RankNumbers& numbers);
    /// @throws std::runtime_error when the rank has ended, or is at another operation.
    [[nodiscard]] RankNumbers receive(int from);

private:
    void send_down(std::span<double> values);

    Ranks& ranks_;
    std::vector<int> children_;
    int parent_ = -1;
    double operation_ = 0.0;  ///< its number in the sequence, times ten, plus its kind
};

}  // namespace orbid::estimator
