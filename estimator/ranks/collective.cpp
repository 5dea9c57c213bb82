#include "estimator/ranks/collective.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <stdexcept>
#include <string>
#include <utility>

namespace orbid::estimator {

void RankNumbers::put(const Eigen::MatrixXd& matrix) {
    put(static_cast<double>(matrix.rows()));
    put(static_cast<double>(matrix.cols()));
    put(std::span(matrix.data(), static_cast<std::size_t>(matrix.size())));
}

double RankNumbers::take() {
    if (at_ >= values_.size()) throw std::runtime_error("ranks: a message is shorter than expected");
    return values_[at_++];
}

Eigen::MatrixXd RankNumbers::take_matrix() {
    const Eigen::Index rows = take_index();
    const Eigen::Index columns = take_index();
    const auto size = static_cast<std::size_t>(rows * columns);
    if (values_.size() - at_ < size) throw std::runtime_error("ranks: a message is shorter than expected");
    Eigen::MatrixXd matrix = Eigen::Map<const Eigen::MatrixXd>(values_.data() + at_, rows, columns);
    at_ += size;
    return matrix;
}

namespace {

/// Operation, sender and receiver before the numbers of a message.
constexpr std::size_t head_size = 3;

double number_at(const std::vector<std::byte>& content, std::size_t index) {
    double value = 0.0;
    std::memcpy(&value, content.data() + index * sizeof value, sizeof value);
    return value;
}

}  // namespace

Collective::Collective(Ranks& ranks) : ranks_(ranks) {
    for (int step = 1; step < count(); step *= 2) {
        if (rank() % (2 * step) != 0) {
            parent_ = rank() - step;
            break;
        }
        if (rank() + step < count()) children_.push_back(rank() + step);
    }
    if (rank() == 0) tree_edges_ = static_cast<std::size_t>(count()) - 1 - children_.size();
}

void Collective::begin(Operation operation) {
    constexpr double kinds = 10.0;
    operation_ = kinds * (std::floor(operation_ / kinds) + 1.0) + static_cast<double>(operation);
}

void Collective::send(int to, const RankNumbers& numbers) {
    std::vector<double> content{operation_, static_cast<double>(rank()), static_cast<double>(to)};
    content.insert(content.end(), numbers.values_.begin(), numbers.values_.end());
    ranks_.send(rank() == 0 ? to : 0, std::as_bytes(std::span(content)));
}

/// The next message for any rank, as it comes.
Collective::Letter Collective::next_letter() {
    RankMessage message = ranks_.receive(rank() == 0 ? Ranks::any : 0);
    if (message.lost)
        throw std::runtime_error("rank " + std::to_string(message.from) + " has ended before the computation did");
    if (message.content.size() < head_size * sizeof(double))
        throw std::runtime_error("ranks: a message of rank " + std::to_string(message.from) +
                                 " is none of a computation");
    Letter letter{number_at(message.content, 0), static_cast<int>(number_at(message.content, 1)),
                  static_cast<int>(number_at(message.content, 2)), std::move(message.content)};
    return letter;
}

RankNumbers Collective::receive(int from) {
    const auto wanted = [&] {
        return std::find_if(waiting_.begin(), waiting_.end(), [from](const Letter& one) { return one.from == from; });
    };
    while (wanted() == waiting_.end()) {
        Letter letter = next_letter();
        if (letter.to == rank()) {
            waiting_.push_back(std::move(letter));
            continue;
        }
        ranks_.send(letter.to, letter.content);
        ++passed_on_;
    }
    const Letter letter = std::move(*wanted());
    waiting_.erase(wanted());
    if (letter.operation != operation_)
        throw std::runtime_error("ranks " + std::to_string(rank()) + " and " + std::to_string(from) +
                                 " are not at the same operation: all ranks need the same program and options");
    RankNumbers numbers;
    numbers.values_.resize(letter.content.size() / sizeof(double) - head_size);
    std::memcpy(numbers.values_.data(), letter.content.data() + head_size * sizeof(double),
                numbers.values_.size() * sizeof(double));
    return numbers;
}

/// Rank 0 passes on what an operation made others send to each other. What one that is ahead already sends of the next
/// operation counts there.
void Collective::pass_on(std::size_t messages) {
    if (rank() != 0) return;
    expected_ += messages;
    while (passed_on_ < expected_) {
        Letter letter = next_letter();
        if (letter.to == 0) {
            waiting_.push_back(std::move(letter));
            continue;
        }
        ranks_.send(letter.to, letter.content);
        ++passed_on_;
    }
}

void Collective::end_along_tree() {
    pass_on(tree_edges_);
}

void Collective::end_with_neighbours(int messages) {
    pass_on(static_cast<std::size_t>(messages) * static_cast<std::size_t>(std::max(count() - 2, 0)));
}

void Collective::tell(std::span<double> values) {
    begin(Operation::tell);
    if (rank() > 0) {
        RankNumbers whole = receive(0);
        for (double& value : values)
            value = whole.take();
        return;
    }
    RankNumbers numbers;
    numbers.put(values);
    for (int other = 1; other < count(); ++other)
        send(other, numbers);
}

void Collective::sum(std::span<double> values) {
    begin(Operation::sum);
    if (rank() > 0) {
        RankNumbers numbers;
        numbers.put(values);
        send(0, numbers);
    }
    for (int other = 1; other < count() && rank() == 0; ++other) {
        RankNumbers part = receive(other);
        for (double& value : values)
            value += part.take();
    }
    tell(values);
}

bool Collective::any(bool value) {
    double count = value ? 1.0 : 0.0;
    sum({&count, 1});
    return count > 0.0;
}

}  // namespace orbid::estimator
