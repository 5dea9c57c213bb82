#pragma once

#include <cstddef>
#include <deque>
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
/// Rank 0 exchanges messages with all others and they with none but rank 0, for more cannot be asked of every kind of
/// ranks: what others send to each other, rank 0 passes on. Numbers are added in the order of the ranks and sent back
/// from rank 0: they are the same bytes on every rank.
///
/// For computations along a tree: rank r receives from r + 1, r + 2, r + 4, ... as long as these powers of two divide
/// r, and then sends to what is left of r without its lowest one. A subtree is a range of successive ranks, in order.
class Collective {
public:
    enum class Operation { sum, tell, neighbours, condense, descend };

    explicit Collective(Ranks& ranks);

    [[nodiscard]] int rank() const { return ranks_.rank(); }
    [[nodiscard]] int count() const { return ranks_.count(); }
    /// The ranks that send to this one along the tree, in the order of their ranges.
    [[nodiscard]] const std::vector<int>& children() const { return children_; }
    /// -1 for rank 0.
    [[nodiscard]] int parent() const { return parent_; }

    /// Replaces numbers by their sums over all ranks.
    void sum(std::span<double> values);
    /// Replaces numbers by those of rank 0.
    void tell(std::span<double> values);
    [[nodiscard]] bool any(bool value);
    /// Returns when every rank has come here. A computation ends with it: until then a rank that ends has failed.
    void meet() { static_cast<void>(any(false)); }

    /// Begins an operation made of send() and receive().
    void begin(Operation operation);
    void send(int to, const RankNumbers& numbers);
    /// @throws std::runtime_error when a rank has ended, or is at another operation.
    [[nodiscard]] RankNumbers receive(int from);
    /// Ends an operation in which one message went along every edge of the tree: rank 0 has then passed all of it on.
    void end_along_tree();
    /// The same where so many messages went from every rank to one neighbour, or to the other.
    void end_with_neighbours(int messages);

private:
    /// A message on its way: its operation, who sent it, who is to have it.
    struct Letter {
        double operation = 0.0;
        int from = 0;
        int to = 0;
        std::vector<std::byte> content;  ///< as it was received, these three first
    };

    [[nodiscard]] Letter next_letter();
    void pass_on(std::size_t messages);

    Ranks& ranks_;
    std::vector<int> children_;
    int parent_ = -1;
    std::size_t tree_edges_ = 0;  ///< that do not end at rank 0
    double operation_ = 0.0;      ///< its number in the sequence, times ten, plus its kind
    std::deque<Letter> waiting_;  ///< for this rank, received but not yet asked for
    std::size_t expected_ = 0;    ///< messages that rank 0 has to pass on in all operations so far
    std::size_t passed_on_ = 0;
};

}  // namespace orbid::estimator
