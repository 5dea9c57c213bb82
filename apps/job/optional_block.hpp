#pragma once

#include <memory>
#include <utility>

namespace orbid::apps {

/// A block that a job may leave out: a std::optional that knows its type by name only, so that whoever does not use the
/// block does not read its header. Copies are deep.
template <class Block>
class OptionalBlock {
public:
    OptionalBlock() = default;
    OptionalBlock(Block block) : block_(std::make_unique<Block>(std::move(block))) {}
    OptionalBlock(const OptionalBlock& other) : block_(other ? std::make_unique<Block>(*other) : nullptr) {}
    OptionalBlock(OptionalBlock&&) noexcept = default;
    OptionalBlock& operator=(OptionalBlock other) noexcept {
        block_ = std::move(other.block_);
        return *this;
    }
    ~OptionalBlock() = default;

    [[nodiscard]] explicit operator bool() const { return block_ != nullptr; }
    [[nodiscard]] Block& operator*() { return *block_; }
    [[nodiscard]] const Block& operator*() const { return *block_; }
    [[nodiscard]] Block* operator->() { return block_.get(); }
    [[nodiscard]] const Block* operator->() const { return block_.get(); }
    void reset() { block_.reset(); }

private:
    std::unique_ptr<Block> block_;
};

}  // namespace orbid::apps
