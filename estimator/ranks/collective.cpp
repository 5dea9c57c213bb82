#include "estimator/ranks/collective.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <stdexcept>
#include <string>

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

Collective::Collective(Ranks& ranks) : ranks_(ranks) {
    for (int step = 1; step < count(); step *= 2) {
        if (rank() % (2 * step) != 0) {
            parent_ = rank() - step;
            break;
        }
        if (rank() + step < count()) children_.push_back(rank() + step);
    }
}

void Collective::begin(Operation operation) {
    constexpr double kinds = 10.0;
    operation_ = kinds * (std::floor(operation_ / kinds) + 1.0) + static_cast<double>(operation);
}

void Collective::send(int to, const RankNumbers& numbers) {
    std::vector<double> content;
    content.reserve(numbers.values_.size() + 1);
    content.push_back(operation_);
    content.insert(content.end(), numbers.values_.begin(), numbers.values_.end());
    ranks_.send(to, std::as_bytes(std::span(content)));
}

RankNumbers Collective::receive(int from) {
    const RankMessage message = ranks_.receive(from);
    if (message.lost)
        throw std::runtime_error("rank " + std::to_string(from) + " has ended before the computation did");
    std::vector<double> content(message.content.size() / sizeof(double));
    std::memcpy(content.data(), message.content.data(), content.size() * sizeof(double));
    if (content.empty() || content.front() != operation_)
        throw std::runtime_error("ranks " + std::to_string(rank()) + " and " + std::to_string(from) +
                                 " are not at the same operation: all ranks need the same program and options");
    RankNumbers numbers;
    numbers.values_.assign(content.begin() + 1, content.end());
    return numbers;
}

void Collective::send_down(std::span<double> values) {
    if (parent_ >= 0) {
        RankNumbers whole = receive(parent_);
        for (double& value : values)
            value = whole.take();
    }
    RankNumbers numbers;
    numbers.put(values);
    for (auto child = children_.rbegin(); child != children_.rend(); ++child)
        send(*child, numbers);
}

void Collective::sum(std::span<double> values) {
    begin(Operation::sum);
    for (const int child : children_) {
        RankNumbers part = receive(child);
        for (double& value : values)
            value += part.take();
    }
    if (parent_ >= 0) {
        RankNumbers numbers;
        numbers.put(values);
        send(parent_, numbers);
    }
    send_down(values);
}

void Collective::tell(std::span<double> values) {
    begin(Operation::tell);
    send_down(values);
}

bool Collective::any(bool value) {
    double count = value ? 1.0 : 0.0;
    sum({&count, 1});
    return count > 0.0;
}

}  // namespace orbid::estimator
