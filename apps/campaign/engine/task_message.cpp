#include "apps/campaign/engine/task_message.hpp"

#include <cstring>
#include <stdexcept>
#include <type_traits>

namespace orbid::apps {

namespace {

/// Appends values to bytes, or takes them from these: one list of members serves both ways.
class Packer {
public:
    template <class Value>
    void operator()(Value& value) {
        if constexpr (std::is_same_v<Value, std::string>) {
            std::uint64_t size = value.size();
            (*this)(size);
            add(value.data(), value.size());
        } else {
            static_assert(std::is_trivially_copyable_v<Value>);
            add(&value, sizeof value);
        }
    }
    [[nodiscard]] std::vector<std::byte> take() { return std::move(bytes_); }

private:
    void add(const void* from, std::size_t size) {
        const auto* const first = static_cast<const std::byte*>(from);
        bytes_.insert(bytes_.end(), first, first + size);
    }
    std::vector<std::byte> bytes_;
};

class Unpacker {
public:
    explicit Unpacker(std::span<const std::byte> bytes) : left_(bytes) {}
    template <class Value>
    void operator()(Value& value) {
        if constexpr (std::is_same_v<Value, std::string>) {
            std::uint64_t size = 0;
            (*this)(size);
            const std::span<const std::byte> content = take(size);
            value.assign(reinterpret_cast<const char*>(content.data()), content.size());
        } else {
            std::memcpy(&value, take(sizeof value).data(), sizeof value);
        }
    }

private:
    std::span<const std::byte> take(std::uint64_t size) {
        if (size > left_.size()) throw std::runtime_error("a message between ranks is cut off");
        const auto taken = left_.first(static_cast<std::size_t>(size));
        left_ = left_.subspan(static_cast<std::size_t>(size));
        return taken;
    }
    std::span<const std::byte> left_;
};

template <class Archive>
void pass_parameter(Archive& archive, TaskParameter& parameter) {
    archive(parameter.name);
    for (double* value :
         {&parameter.value, &parameter.sd, &parameter.lower, &parameter.upper, &parameter.truth, &parameter.bound})
        archive(*value);
}

template <class Archive>
void pass(Archive& archive, TaskMessage& message) {
    archive(message.kind);
    archive(message.number);
    archive(message.text);
    if (message.kind != TaskMessage::Kind::outcome) return;
    TaskOutcome& outcome = message.outcome;
    archive(outcome.number);
    archive(outcome.state);
    archive(outcome.exit_code);
    archive(outcome.status);
    archive(outcome.message);
    archive(outcome.objective);
    archive(outcome.result);
    archive(outcome.started);
    archive(outcome.seconds);
    archive(outcome.processor_seconds);
    archive(outcome.host);
    archive(outcome.rank);
    std::uint64_t count = outcome.parameters.size();
    archive(count);
    if (count > 1'000'000) throw std::runtime_error("a message between ranks has no meaning");
    outcome.parameters.resize(static_cast<std::size_t>(count));
    for (TaskParameter& parameter : outcome.parameters)
        pass_parameter(archive, parameter);
}

}  // namespace

std::vector<std::byte> packed(const TaskMessage& message) {
    TaskMessage copy = message;
    Packer packer;
    pass(packer, copy);
    return packer.take();
}

TaskMessage unpacked(std::span<const std::byte> bytes) {
    TaskMessage message;
    Unpacker unpacker(bytes);
    pass(unpacker, message);
    return message;
}

}  // namespace orbid::apps
