// Carries out frames, one after the other: words to the load port and to the stream port of the core, and a reply to each.
//
//     1 hello    nothing                                       begins anew: a recording under way is cut off
//     2 load     memory, address (3 bytes), bytes per word, words       written from this address on
//     3 words    words of the stream, 3 bytes each             kind times 2^16, and channel
//     4 report   1 or 0                                        whether spikes are reported
//
// Numbers have their highest byte first. A frame is replied to when it has been carried out, or with what is wrong with it.
module commands #(
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
    input  logic         frame_valid,
    output logic         frame_ready,
    input  logic [7:0]   frame_data,
    input  logic         frame_last,
    output logic         load_valid,
    output logic [2:0]   load_memory,
    output logic [23:0]  load_address,
    output logic [127:0] load_data,
    output logic         word_valid,
    input  logic         word_ready,
    output logic [1:0]   word_kind,
    output logic [15:0]  word_channel,
    input  logic         answered,     // the answer of a recording is on its way to the host
    output logic         reply_valid,
    input  logic         reply_ready,
    output logic         reply_hello,
    output logic [7:0]   reply_error,  // 0: none
    output logic [7:0]   reply_number,
    output logic         report,
    output logic         loaded,       // a program is there, and was started
    output logic         running       // a recording is under way, or its answer is
);
    localparam logic [7:0] HELLO = 1, LOAD = 2, WORDS = 3, REPORT = 4;
    localparam logic [7:0] CUT_OFF = 6, NO_TYPE = 7, FORM = 8, NO_PLACE = 9, BUSY = 10, NO_PROGRAM = 11;
    localparam logic [1:0] END = 2, STOP = 3;
    localparam logic [2:0] TYPE = 0, NUMBER = 1, PAYLOAD = 2, WORD = 3, SKIP = 4, CUT = 5, DROP = 6, SETTLE = 7;

    logic [2:0]   state;
    logic         replying;
    logic [7:0]   kind;
    logic [7:0]   refusal;
    logic         over;       // the word is the last one of its frame
    logic         placed;     // memory, address and size of a load are known
    logic [4:0]   size;       // bytes per word of a load
    logic [4:0]   index;      // bytes of this item so far
    logic [127:0] number;     // these bytes
    logic         open;       // words of a recording came, and no end yet
    logic         awaited;    // its end did, and no answer yet

    wire [127:0] item = {index == 0 ? 120'b0 : number[119:0], frame_data};
    wire [4:0]   item_size = kind == LOAD ? (placed ? size : 5'd5) : kind == WORDS ? 5'd3 : 5'd1;
    wire         whole = index + 1 == item_size;
    wire         take = frame_valid && frame_ready;
    wire         word_taken = word_valid && word_ready;

    logic [31:0] words;  // of the memory that is loaded
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

    // Of the next word. A byte is taken in every other cycle at most, so this is known in time.
    logic outside;
    always_ff @(posedge clk) outside <= {8'b0, load_address} + {31'b0, load_valid} >= words;

    logic [7:0] unfit;  // what is wrong with a frame, once its type and number are known
    always_comb begin
        unfit = 0;
        if (kind == 0 || kind > REPORT) unfit = NO_TYPE;
        else if ((kind == HELLO) != frame_last) unfit = FORM;
        else if (kind == LOAD && running) unfit = BUSY;
        else if (kind == WORDS && !loaded) unfit = NO_PROGRAM;
    end

    wire no_place = item[39:32] > 7 || item[7:0] > 16;
    wire no_word = item[23:18] != 0;
    wire no_switch = item[7:1] != 0;
    logic [7:0] wrong;  // what is wrong with it at this byte of the payload
    always_comb begin
        wrong = 0;
        if (!whole) wrong = frame_last ? FORM : 8'd0;
        else if (kind == LOAD && !placed) begin
            if (frame_last || no_place) wrong = FORM;
        end else if (kind == LOAD) begin
            if (outside) wrong = NO_PLACE;
        end else if (kind == WORDS) begin
            if (no_word) wrong = FORM;
        end else if (!frame_last || no_switch) wrong = FORM;
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
                {index, placed} <= 0;
                state <= NUMBER;
            end
            NUMBER: if (take) begin
                reply_number <= frame_data;
                refusal <= unfit;
                state <= PAYLOAD;
                if (unfit != 0) begin
                    replying <= frame_last;
                    state <= frame_last ? TYPE : SKIP;
                end else if (kind == HELLO) state <= open ? CUT : SETTLE;
            end
            PAYLOAD: if (take) begin
                number <= item;
                index <= whole ? 0 : index + 1;
                over <= frame_last;
                if (wrong != 0) begin
                    refusal <= wrong;
                    replying <= frame_last;
                    state <= frame_last ? TYPE : SKIP;
                end else if (whole && kind == WORDS) state <= WORD;
                else if (frame_last) begin
                    replying <= 1;
                    state <= TYPE;
                end
                if (wrong == 0 && whole && kind == LOAD) begin
                    placed <= 1;
                    if (placed) load_valid <= 1;
                    else {load_memory, load_address, size} <= {item[34:32], item[31:8], item[4:0]};
                end
                if (wrong == 0 && kind == REPORT) report <= item[0];
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
            default: if (!awaited) begin
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
