// Carries out the frames of the host, one after the other: passes words to the load port and to the stream port of the core,
// and asks replies.sv for a reply to each frame. A frame arrives byte by byte, as frame_receiver.sv gives it:
//
//     type       payload                                                what it does
//     1 hello    nothing                                                starts anew: a recording under way is cut off
//     2 load     memory, address (3 bytes), bytes per word, words       writes the words from this address on
//     3 words    words of the stream (3 bytes: kind * 2^16 + channel)   passes them to the stream
//     4 report   1 or 0                                                 whether spikes are reported
//
// Numbers have their highest byte first. A frame is replied to once it has been carried out, or with what is wrong with it.
module commands #(
    // Words of each memory, which addresses of loads are checked against.
    parameter integer AXONS = 2048,
    parameter integer SYNAPSES = 16384,
    parameter integer COMPARTMENTS = 512,
    parameter integer VISITS = 128,
    parameter integer WEIGHTS = 64,
    parameter integer PHASES = 512,
    parameter integer SETTINGS = 16,
    parameter integer RUN = 11  // the setting that starts the core
) (
    input  logic         clk,
    input  logic         reset,
    // Bytes of frames: type, sequence number, payload.
    input  logic         frame_valid,
    output logic         frame_ready,
    input  logic [7:0]   frame_data,
    input  logic         frame_last,
    // To the load port of the core, which is always ready.
    output logic         load_valid,
    output logic [2:0]   load_memory,
    output logic [23:0]  load_address,
    output logic [127:0] load_data,
    // To the stream port of the core.
    output logic         word_valid,
    input  logic         word_ready,
    output logic [1:0]   word_kind,    // 0 event, 1 tick, 2 end, 3 stop
    output logic [15:0]  word_channel,
    input  logic         answered,     // the answer of a recording is on its way to the host
    // What to reply to the frame of this number.
    output logic         reply_valid,
    input  logic         reply_ready,
    output logic         reply_hello,  // the frame was a hello
    output logic [7:0]   reply_error,  // the problem; 0: none
    output logic [7:0]   reply_number,
    output logic         report,       // the host wants spikes
    output logic         loaded,       // a program is there, and was started
    output logic         running       // words of a recording came, and its answer has not left yet
);
    // Types of frames, and problems, are those of docs/reference/hardware/serial-line-and-axi.md; problems 1 to 5 are those of
    // frame_receiver.sv.
    localparam logic [7:0] HELLO = 1, LOAD = 2, WORDS = 3, REPORT = 4;
    localparam logic [7:0] CUT_OFF = 6, NO_TYPE = 7, FORM = 8, NO_PLACE = 9, BUSY = 10, NO_PROGRAM = 11;
    localparam logic [1:0] END = 2, STOP = 3;
    // TYPE, NUMBER, PAYLOAD: a byte of the frame is awaited. WORD: the stream takes a word. SKIP: the rest of a frame with an
    // error passes. After a hello, CUT: a recording is under way, and is reported as cut off; DROP: the stream takes a stop;
    // SETTLE: the answer of an earlier recording is awaited.
    localparam logic [2:0] TYPE = 0, NUMBER = 1, PAYLOAD = 2, WORD = 3, SKIP = 4, CUT = 5, DROP = 6, SETTLE = 7;

    logic [2:0]   state;
    logic         replying;   // a reply waits to be taken; all else stands still
    logic [7:0]   kind;       // the type of the frame
    logic [7:0]   refusal;    // the problem that the reply will name; 0: none
    // A payload is a row of items: the destination of a load (5 bytes), a word of a load, a word of the stream, or a switch.
    logic         over;       // the item is the last one of its frame
    logic         destination_known;     // memory, address and size of a load are known
    logic [4:0]   size;       // bytes per word of a load
    logic [4:0]   index;      // bytes of this item so far
    logic [127:0] number;     // these bytes, the last one lowest
    logic         open;       // words of a recording came, but not its end
    logic         awaited;    // the end of a recording came, but its answer did not

    // The item with the byte that is taken now; how many bytes it has; whether this is its last one.
    wire [127:0] item = {index == 0 ? 120'b0 : number[119:0], frame_data};
    wire [4:0]   item_size = kind == LOAD ? (destination_known ? size : 5'd5) : kind == WORDS ? 5'd3 : 5'd1;
    wire         whole = index + 1 == item_size;
    wire         take = frame_valid && frame_ready;
    wire         word_taken = word_valid && word_ready;

    logic [31:0] words;  // how many words the memory that is being loaded has
    always_comb
        case (load_memory)
            0: words = SETTINGS;
            1: words = AXONS;
            2: words = SYNAPSES;
            3, 4: words = COMPARTMENTS;
            5: words = VISITS;
            6: words = WEIGHTS;
            default: words = PHASES;
        endcase

    // The next word of a load would lie behind the end of its memory. This is a cycle old, but in time: a byte is taken in
    // every other cycle at most, as one_word.sv stands in front.
    logic outside;
    always_ff @(posedge clk) outside <= {8'b0, load_address} + {31'b0, load_valid} >= words;

    logic [7:0] header_error;  // what is wrong with a frame, once its type and number are known; 0: nothing
    always_comb begin
        header_error = 0;
        if (kind == 0 || kind > REPORT) header_error = NO_TYPE;
        else if ((kind == HELLO) != frame_last) header_error = FORM;
        else if (kind == LOAD && running) header_error = BUSY;
        else if (kind == WORDS && !loaded) header_error = NO_PROGRAM;
    end

    wire no_place = item[39:32] > 7 || item[7:0] > 16;  // of eight memories; words of 128 bits have 16 bytes
    wire no_word = item[23:18] != 0;                    // the highest six bits, above kind and channel
    wire no_switch = item[7:1] != 0;                    // neither 0 nor 1
    logic [7:0] payload_error;  // what is wrong with the frame at this byte of its payload; 0: nothing
    always_comb begin
        payload_error = 0;
        if (!whole) payload_error = frame_last ? FORM : 8'd0;
        else if (kind == LOAD && !destination_known) begin
            if (frame_last || no_place) payload_error = FORM;
        end else if (kind == LOAD) begin
            if (outside) payload_error = NO_PLACE;
        end else if (kind == WORDS) begin
            if (no_word) payload_error = FORM;
        end else if (!frame_last || no_switch) payload_error = FORM;
    end

    assign frame_ready = !replying && (state == TYPE || state == NUMBER || state == PAYLOAD || state == SKIP);
    assign load_data = number;
    assign word_valid = state == WORD || (state == DROP && !replying);
    assign word_kind = state == DROP ? STOP : number[17:16];
    assign word_channel = number[15:0];
    assign reply_valid = replying;
    assign reply_hello = kind == HELLO;
    assign reply_error = refusal;
    assign running = open || awaited;

    always_ff @(posedge clk) begin
        load_valid <= 0;
        if (load_valid) begin
            load_address <= load_address + 1;
            // Only the last word of a program starts the core; any other word means that it is being loaded again.
            loaded <= load_memory == 0 && {8'b0, load_address} == RUN;
        end
        if (word_taken) begin
            open <= !word_kind[1];
            if (word_kind == END) awaited <= 1;
        end
        if (answered) awaited <= 0;
        if (replying) begin
            if (reply_ready) {replying, refusal} <= 0;
        end else case (state)
            TYPE: if (take) begin
                kind <= frame_data;
                {index, destination_known} <= 0;
                state <= NUMBER;
            end
            NUMBER: if (take) begin
                reply_number <= frame_data;
                refusal <= header_error;
                state <= PAYLOAD;
                if (header_error != 0) begin
                    replying <= frame_last;
                    state <= frame_last ? TYPE : SKIP;
                end else if (kind == HELLO) state <= open ? CUT : SETTLE;
            end
            PAYLOAD: if (take) begin
                number <= item;
                index <= whole ? 0 : index + 1;
                over <= frame_last;
                if (payload_error != 0) begin
                    refusal <= payload_error;
                    replying <= frame_last;
                    state <= frame_last ? TYPE : SKIP;
                end else if (whole && kind == WORDS) state <= WORD;
                else if (frame_last) begin
                    replying <= 1;
                    state <= TYPE;
                end
                if (payload_error == 0 && whole && kind == LOAD) begin
                    destination_known <= 1;
                    if (destination_known) load_valid <= 1;
                    else {load_memory, load_address, size} <= {item[34:32], item[31:8], item[4:0]};
                end
                if (payload_error == 0 && kind == REPORT) report <= item[0];
            end
            WORD: if (word_taken) begin
                replying <= over;
                state <= over ? TYPE : PAYLOAD;
            end
            SKIP: if (take && frame_last) begin
                replying <= 1;
                state <= TYPE;
            end
            CUT: begin
                refusal <= CUT_OFF;
                replying <= 1;
                state <= DROP;
            end
            DROP: if (word_taken) state <= SETTLE;
            default: if (!awaited) begin  // SETTLE
                report <= 0;
                replying <= 1;
                state <= TYPE;
            end
        endcase
        if (reset) begin
            state <= TYPE;
            {load_valid, replying, refusal, open, awaited, report, loaded} <= 0;
        end
    end
endmodule
